!> How a scene is solved, judged and stored: the groups `&solver`, `&sampling`, `&certificate` and `&output`.
module hb_scene_settings
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_fftw, only: planning, planning_names
   use hb_first_way, only: first_way_names
   use hb_kinds, only: wp
   use hb_memory_estimate, only: gib
   use hb_properties, only: limits_t, properties_t
   use hb_response, only: new_response
   use hb_scene, only: accuracy_t, certificate_config_t, scene_t
   use hb_solver_types, only: method_names, share_of_solver, start_names, unit_of_work
   use hb_stability, only: stability_config_t, stability_method_names
   use hb_structure, only: structure_t
   use hb_text, only: string_t, to_text
   use hb_torus, only: default_samples, fast_size, new_torus, torus_t
   implicit none
   private
   public :: read_accuracy, read_certificate, read_output, read_sampling, read_solver, read_stability

   real(wp), parameter :: much_patience = 6.0_wp                      ! usual points that stability may take
   character(9), parameter :: first_guess_names(5) = [character(9) :: "auto", "linear", "zero", "neighbour", "march"]
   character(9), parameter :: kink_names(2) = [character(9) :: "plain", "corrected"]

contains

   !> Reads `&solver` into its configuration.
   subroutine read_solver(self, group)
      type(scene_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      character(:), allocatable :: first_guess, first_jacobian, name, way
      real(wp) :: limit

      associate (solver => self%solver)
         name = trim(method_names(solver%method))
         first_jacobian = trim(start_names(merge(2, 1, solver%start_with_tangent)))
         first_guess = "auto"
         call group%get("method", name, choices=method_names)
         solver%has_tolerance = group%given("tolerance")
         call group%get("tolerance", solver%tolerance, unit="1", limits=limits_t(above=0.0_wp))
         call group%get("max_iterations", solver%max_iterations, limits=limits_t(minimum=0))
         call group%get("line_search", solver%line_search)
         call group%get("rescue", solver%rescue)
         call group%get("rescue_by_march", solver%rescue_by_march)
         way = trim(first_way_names(self%first_way))
         call group%get("first_way", way, choices=first_way_names)
         self%first_way = max(1, findloc(first_way_names == way, .true., dim=1))
         call group%get("homotopy_iterations", solver%homotopy_iterations, limits=limits_t(minimum=0))
         call group%get("memory", solver%memory, limits=limits_t(minimum=1, maximum=10000))
         call group%get("first_jacobian", first_jacobian, choices=start_names)
         call group%get("first_guess", first_guess, choices=first_guess_names)
         call group%get("chain_length", self%chain%length, limits=limits_t(minimum=1, maximum=1000000))
         call group%get("secant", self%chain%secant)
         limit = 0.0_wp
         call group%get("memory_limit", limit, unit="GiB", limits=limits_t(minimum=0.0_wp))
         if (limit > 0.0_wp) self%memory_limit = limit*gib
         limit = 0.0_wp
         call group%get("time_limit", limit, unit="s", limits=limits_t(minimum=0.0_wp))
         if (limit > 0.0_wp) solver%time_limit = limit
         limit = solver%rescue_work/(share_of_solver*unit_of_work)
         call group%get("rescue_work", limit, limits=limits_t(minimum=0.0_wp))
         solver%rescue_work = share_of_solver*limit*unit_of_work
         solver%method = max(1, findloc(method_names == name, .true., dim=1))
         solver%start_with_tangent = first_jacobian == start_names(2)
         self%chain%is_auto = first_guess == "auto"
         self%chain%is_on = first_guess == "neighbour"
         self%start_from_linear = first_guess /= "zero"
         self%start_from_march = first_guess == "march"
      end associate
   end subroutine read_solver

   !> Reads `&accuracy`: the tolerance, what it is for, what may be spent on it. Without a set in `&harmonics` it is on in any case.
   subroutine read_accuracy(self, document, structure, n_tones)
      type(accuracy_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: n_tones
      type(properties_t), pointer :: group
      type(string_t), allocatable :: names(:)
      type(error_t), allocatable :: error
      real(wp) :: work
      integer :: i

      allocate (self%outputs(0))
      group => document%optional_group("harmonics")
      self%grows_set = .not. (group%given("order") .or. group%given("tuples") .or. group%given("set") .or. group%given("odd_only"))
      self%is_on = document%count("accuracy") > 0 .or. self%grows_set
      if (.not. self%is_on) return
      group => document%optional_group("accuracy")
      work = self%max_work/unit_of_work
      call group%get("tolerance", self%tolerance, unit="1", limits=limits_t(above=0.0_wp))
      call group%get("of", names)
      if (.not. allocated(names)) allocate (names(0))
      deallocate (self%outputs)
      allocate (self%outputs(size(names)))
      do i = 1, size(names)
         call new_response(self%outputs(i), names(i)%value, structure, n_tones, error)
         if (allocated(error)) call group%problem("of", error%message)
      end do
      if (size(names) > 0 .and. document%count("curve") > 0) &
         call group%problem("of", "is for points and sweeps; leave it out with &curve, whose tolerance is that of the motion")
      call group%get("max_harmonics", self%max_harmonics, limits=limits_t(minimum=1, maximum=1000000))
      call group%get("max_samples", self%max_samples, limits=limits_t(minimum=1, maximum=100000000))
      call group%get("max_work", work, limits=limits_t(minimum=0.0_wp))
      self%max_work = work*unit_of_work
   end subroutine read_accuracy

   !> Reads `&sampling`: `samples` per tone, whether kinks between them are corrected, effort and wisdom file of FFTW.
   subroutine read_sampling(self, group, on_curve)
      type(scene_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      logical, intent(in) :: on_curve                                 !! the motion is followed: samples must not make folds
      integer, allocatable :: samples(:)
      character(:), allocatable :: effort, kinks
      type(error_t), allocatable :: error
      real(wp) :: oversampling
      integer :: degree, i

      degree = 1
      do i = 1, size(self%laws)
         if (self%laws(i)%law%degree == 0 .or. degree == 0) then
            degree = 0
         else
            degree = max(degree, self%laws(i)%law%degree)
         end if
      end do
      samples = [0]                                                   ! so that a sweep over the order has its own at each point
      call group%get("samples", samples, limits=limits_t(minimum=0))
      oversampling = 0.0_wp
      call group%get("oversampling", oversampling, unit="1", limits=limits_t(minimum=0.0_wp, maximum=1000.0_wp))
      self%accuracy%refines_grid = all(samples == 0) .and. .not. oversampling > 0.0_wp
      if (oversampling > 0.0_wp) then
         if (any(samples > 0)) call group%problem("oversampling", "give either 'samples' or 'oversampling', not both")
         samples = fast_size(ceiling(max(1.0_wp, oversampling)*(2*self%harmonics%highest + 1)))
      end if
      if (size(samples) == 1) samples = spread(samples(1), 1, self%tones%n_tones)
      if (size(samples) == self%tones%n_tones) &
         samples = merge(samples, default_samples(self%harmonics, degree), samples > 0)
      call new_torus(self%torus, samples, self%harmonics, error)
      if (allocated(error)) call group%problem("samples", error%message)
      kinks = trim(kink_names(merge(2, 1, self%accuracy%is_on .or. on_curve)))
      call group%get("kinks", kinks, choices=kink_names)
      self%torus%corrects_kinks = kinks == kink_names(2)

      effort = planning_names(1)
      call group%get("planning", effort, choices=planning_names)
      select case (effort)
      case ("measure"); self%planning = planning%measure
      case ("patient"); self%planning = planning%patient
      case default; self%planning = planning%estimate
      end select
      call group%get("wisdom", self%wisdom)
   end subroutine read_sampling

   !> Reads `&certificate`: whether it is made, and its thresholds.
   subroutine read_certificate(self, group)
      type(certificate_config_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group

      call group%get("is_on", self%is_on)
      call group%get("truncation", self%truncation, unit="1", limits=limits_t(above=0.0_wp))
      call group%get("aliasing", self%aliasing, unit="1", limits=limits_t(above=0.0_wp))
      call group%get("penetration", self%penetration, unit="1", limits=limits_t(above=0.0_wp))
      call group%get("impact", self%impact, unit="1", limits=limits_t(above=0.0_wp))
      call group%get("improvement_steps", self%improvement_steps, limits=limits_t(minimum=0, maximum=1000))
      call group%get("commensurability", self%commensurability, unit="1", limits=limits_t(minimum=0.0_wp))
   end subroutine read_certificate

   !> Reads `&stability`: whether and how multipliers are found.
   subroutine read_stability(self, group, is_patient)
      type(stability_config_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      logical, intent(in) :: is_patient                               !! a motion with one tone is followed, or found to a tolerance
      character(:), allocatable :: name

      name = trim(stability_method_names(self%method))
      if (is_patient) self%patience = much_patience
      call group%get("method", name, choices=stability_method_names)
      call group%get("tolerance", self%tolerance, unit="1", limits=limits_t(above=0.0_wp))
      self%method = max(1, findloc(stability_method_names == name, .true., dim=1)) - 1
   end subroutine read_stability

   !> Reads `&output`: title, stored degrees of freedom, grid of stored surfaces.
   subroutine read_output(self, group)
      type(scene_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(string_t), allocatable :: names(:)
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      integer, allocatable :: dofs(:)
      integer :: i

      associate (output => self%output)
         output%title = ""
         call group%get("title", output%title)
         call group%get("samples", output%samples, limits=limits_t(minimum=1))
         if (.not. allocated(output%samples)) allocate (output%samples(0))
         if (size(output%samples) == 1) output%samples = spread(output%samples(1), 1, self%tones%n_tones)
         if (size(output%samples) > 0 .and. size(output%samples) /= self%tones%n_tones) then
            call group%problem("samples", "give one number, or one for each of the "//to_text(self%tones%n_tones)//" tones")
         else if (size(output%samples) > 0) then
            call new_torus(torus, output%samples, self%harmonics, error)
            if (allocated(error)) call group%problem("samples", error%message)
         end if
         call group%get("dofs", names)
         if (allocated(names)) then
            allocate (output%dofs(0))
            do i = 1, size(names)
               call self%structure%find_dofs(names(i)%value, dofs, error)
               if (allocated(error)) then
                  call group%problem("dofs", error%message)
               else
                  output%dofs = [output%dofs, dofs]
               end if
            end do
         else
            output%dofs = [(i, i=1, self%structure%n_dofs)]
         end if
      end associate
   end subroutine read_output
end module hb_scene_settings
