!> Solution, assessment and output of a model: the groups `&solver`, `&accuracy`, `&sampling`, `&error_estimate`, `&stability`,
!> `&integration` and `&output`.
module hb_model_settings
   use hb_discretisation, only: discretisation_t, symmetry
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_integration_config, only: integration_config_t
   use hb_kinds, only: gib, wp
   use hb_model, only: model_t
   use hb_model_basis, only: why_not_odd
   use hb_options, only: accuracy_t, error_estimate_config_t
   use hb_properties, only: properties_t
   use hb_response, only: new_response
   use hb_solver_types, only: share_of_solver, unit_of_work
   use hb_stability, only: stability_config_t
   use hb_structure, only: structure_t
   use hb_system, only: system_t
   use hb_text, only: string_t, to_text
   use hb_threads, only: are_threads_available
   use hb_torus, only: default_samples, fast_size, new_torus, torus_t
   implicit none
   private
   public :: check_symmetry, read_accuracy, read_error_estimate, read_integration, read_output, read_sampling, read_solver
   public :: read_stability

   real(wp), parameter :: much_patience = 6.0_wp                      ! work of stability, relative to a usual point

contains

   !> Reads `&solver` into its configuration.
   subroutine read_solver(self, group)
      type(model_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      character(:), allocatable :: first_guess
      real(wp) :: limit
      integer :: first_jacobian                                       ! linear, tangent

      associate (solver => self%options%solver)
         call group%choose("method", solver%method)
         solver%has_tolerance = group%given("tolerance")
         call group%get("tolerance", solver%tolerance)
         call group%get("max_iterations", solver%max_iterations)
         call group%get("line_search", solver%line_search)
         call group%get("fallback", solver%fallback)
         call group%get("fallback_by_integration", solver%fallback_by_integration)
         call group%choose("primary_method", self%options%primary_method)
         call group%get("homotopy_iterations", solver%homotopy_iterations)
         call group%get("memory", solver%memory)
         call group%choose("first_jacobian", first_jacobian)
         call group%get("first_guess", first_guess)
         call group%get("chain_length", self%options%chain%length)
         call group%get("secant", self%options%chain%secant)
         call group%get("memory_limit", limit)
         if (limit > 0.0_wp) self%options%memory_limit = limit*gib
         call group%get("threads", solver%n_threads)
         if (solver%n_threads > 1 .and. .not. are_threads_available()) &
            call group%problem("threads", "this program was built without threads (HB_THREADS=OFF); 1 is permitted")
         call group%get("time_limit", limit)
         if (limit > 0.0_wp) solver%time_limit = limit
         solver%has_max_fallback_work = group%given("max_fallback_work")
         call group%get("max_fallback_work", limit)
         solver%max_fallback_work = share_of_solver*limit*unit_of_work
         solver%start_with_tangent = first_jacobian == 2
         self%options%chain%is_auto = first_guess == "auto"
         self%options%chain%is_on = first_guess == "neighbour"
         self%options%start%from_linear = first_guess /= "zero"
         self%options%start%from_integration = first_guess == "integration"
      end associate
   end subroutine read_solver

   !> Reads `&accuracy`: the tolerance, the quantities to which it applies, and the limits of the search. Without a
   !> set in `&harmonics` it is always on.
   subroutine read_accuracy(self, document, structure, n_tones, is_followed)
      type(accuracy_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: n_tones
      logical, intent(in) :: is_followed
      type(properties_t), pointer :: group
      type(string_t), allocatable :: names(:)
      type(error_t), allocatable :: error
      real(wp) :: work
      integer :: i

      allocate (self%outputs(0))
      group => document%optional_group("harmonics")
      self%grows_set = .not. (group%given("order") .or. group%given("tuples") .or. group%given("set") .or. group%given("odd_only"))
      self%is_on = document%is_given("accuracy") .or. self%grows_set
      if (.not. self%is_on) then                                      ! the group of an earlier reading has no keys in this one
         if (document%count("accuracy") > 0) group => document%group("accuracy", 1)
         return
      end if
      group => document%optional_group("accuracy")
      call group%get("tolerance", self%tolerance)
      call group%get("of", names)
      if (.not. allocated(names)) allocate (names(0))
      deallocate (self%outputs)
      allocate (self%outputs(size(names)))
      do i = 1, size(names)
         call new_response(self%outputs(i), names(i)%value, structure, n_tones, error)
         if (allocated(error)) call group%problem("of", error%message)
      end do
      if (size(names) > 0 .and. is_followed) &
         call group%problem("of", "is for points and sweeps; leave it out with &curve, whose tolerance is that of the motion")
      call group%get("max_harmonics", self%max_harmonics)
      call group%get("max_samples", self%max_samples)
      call group%get("max_work", work)
      self%max_work = work*unit_of_work
   end subroutine read_accuracy

   !> Reads `&sampling`: `samples` per tone, whether kinks between them are corrected.
   subroutine read_sampling(self, group)
      type(model_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      integer, allocatable :: samples(:)
      character(:), allocatable :: kinks
      type(error_t), allocatable :: error
      real(wp) :: oversampling
      integer :: degree, i

      degree = 1
      do i = 1, size(self%system%laws)
         if (self%system%laws(i)%law%degree == 0 .or. degree == 0) then
            degree = 0
         else
            degree = max(degree, self%system%laws(i)%law%degree)
         end if
      end do
      call group%get("samples", samples)
      call group%get("oversampling", oversampling)
      self%options%accuracy%refines_grid = all(samples == 0) .and. .not. oversampling > 0.0_wp
      if (oversampling > 0.0_wp) then
         if (any(samples > 0)) call group%problem("oversampling", "give either 'samples' or 'oversampling', not both")
         samples = fast_size(ceiling(max(1.0_wp, oversampling)*(2*self%discretisation%harmonics%highest + 1)))
      end if
      if (size(samples) == 1) samples = spread(samples(1), 1, self%system%tones%n_tones)
      if (size(samples) == self%system%tones%n_tones) &
         samples = merge(samples, default_samples(self%discretisation%harmonics, degree), samples > 0)
      call new_torus(self%discretisation%torus, samples, self%discretisation%harmonics, error)
      if (allocated(error)) call group%problem("samples", error%message)
      kinks = "plain"
      if (self%options%accuracy%is_on .or. self%options%purpose%is_followed) kinks = "corrected" ! samples must not create folds
      call group%get("kinks", kinks)
      self%discretisation%torus%corrects_kinks = kinks == "corrected"
   end subroutine read_sampling

   !> Reads `&error_estimate`: whether it is computed, and its thresholds.
   subroutine read_error_estimate(self, group)
      type(error_estimate_config_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group

      call group%get("is_on", self%is_on)
      call group%get("truncation", self%truncation)
      call group%get("aliasing", self%aliasing)
      call group%get("penetration", self%penetration)
      call group%get("impact", self%impact)
      call group%get("improvement_steps", self%improvement_steps)
      call group%get("commensurability", self%commensurability)
   end subroutine read_error_estimate

   !> Reads `&stability`: whether and how multipliers are computed.
   subroutine read_stability(self, group, is_patient)
      type(stability_config_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      logical, intent(in) :: is_patient !! a motion of one or two tones is followed: its events need multipliers

      if (is_patient) self%patience = much_patience
      call group%choose("method", self%method)
      self%method = self%method - 1
      if (group%given("noise_frequency")) call group%get("noise_frequency", self%noise_frequency)
      call group%get("tolerance", self%tolerance)
   end subroutine read_stability

   !> Reads `&integration`.
   subroutine read_integration(self, group)
      type(integration_config_t), intent(out) :: self
      type(properties_t), intent(inout) :: group

      self%record = ""
      call group%choose("method", self%method)
      call group%get("step", self%step)
      call group%get("steps_per_period", self%steps_per_period)
      call group%get("duration", self%duration)
      call group%get("transient", self%transient)
      call group%get("decimation", self%decimation)
      call group%get("tolerance", self%tolerance)
      call group%get("is_stiff", self%is_stiff)
      if (group%given("restitution")) call group%get("restitution", self%restitution)
      call group%get("spectral_radius", self%spectral_radius)
      call group%choose("start", self%start)
      call group%get("continue", self%record)
      call group%get("starts", self%starts)
      call group%get("n_peaks", self%n_peaks)
   end subroutine read_integration

   !> Reads `&output`: title, stored degrees of freedom, grid of stored surfaces.
   subroutine read_output(self, group)
      type(model_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(string_t), allocatable :: names(:)
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      integer, allocatable :: dofs(:)
      integer :: i

      associate (output => self%options%output)
         call group%get("title", output%title)
         call group%get("samples", output%samples)
         if (.not. allocated(output%samples)) allocate (output%samples(0))
         if (size(output%samples) == 1) output%samples = spread(output%samples(1), 1, self%system%tones%n_tones)
         if (size(output%samples) > 0 .and. size(output%samples) /= self%system%tones%n_tones) then
            call group%problem("samples", "give one number, or one for each of the "//to_text(self%system%tones%n_tones)//" tones")
         else if (size(output%samples) > 0) then
            call new_torus(torus, output%samples, self%discretisation%harmonics, error)
            if (allocated(error)) call group%problem("samples", error%message)
         end if
         call group%get("dofs", names)
         if (allocated(names)) then
            allocate (output%dofs(0))
            do i = 1, size(names)
               call self%system%structure%find_dofs(names(i)%value, dofs, error)
               if (allocated(error)) then                            ! only one error: each of them searches for the closest name
                  call group%problem("dofs", error%message)
                  exit
               end if
               output%dofs = [output%dofs, dofs]
            end do
         else
            output%dofs = [(i, i=1, self%system%structure%n_dofs)]
         end if
      end associate
   end subroutine read_output

   !> Rejects `symmetry = 'odd'` if the equations are not odd.
   subroutine check_symmetry(system, discretisation, group)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group
      character(:), allocatable :: reason
      integer :: i

      if (discretisation%symmetry /= symmetry%odd .or. .not. allocated(discretisation%torus%n_samples)) return
      if (.not. all([(allocated(system%laws(i)%law%dofs), i=1, size(system%laws))])) return ! already reported
      reason = trim(why_not_odd(system%laws, discretisation%harmonics, discretisation%torus, &
                                 system%loads_in(discretisation%harmonics)))
      if (len(reason) > 0) call group%problem("symmetry", "must not be 'odd': "//reason// &
                                              "; 'auto' uses the symmetry where there is one")
   end subroutine check_symmetry
end module hb_model_settings
