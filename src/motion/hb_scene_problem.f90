!> The balance of a scene whose input has one value that moves: one more parameter of the problem, beside base frequencies and
!> artificial damping.
!>
!> A value that is the frequency of a tone moves the balance; loads that grow with frequencies go along. Any other value is set in
!> the document of the scene, and what depends on it is made anew. The derivative of the residual by it is exact for frequencies,
!> and for loads, which the residual is linear in; else a central difference. Source: docs/why/theory.md, section 6.7.
module hb_scene_problem
   use hb_balance, only: balance_t, new_balance
   use hb_coordinates, only: coordinates_t
   use hb_document, only: document_t, parameter_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_law_coordinates, only: laws_at
   use hb_problem, only: problem_t
   use hb_rung, only: put_on_rung, rung_t
   use hb_scene, only: scene_t
   use hb_scene_coordinates, only: coordinates_of
   use hb_scene_loads, only: read_loads
   use hb_scene_reader, only: update_scene
   implicit none
   private
   public :: moving_value_t, new_scene_problem, scene_problem_t

   character(*), parameter :: several = "several"                     ! groups, in which values follow the one that moves
   real(wp), parameter :: apart = 1.0e-5_wp                           ! values of a central difference, relative to the range

   !> A value of the input that moves, and what of the scene moves with it.
   type :: moving_value_t
      type(parameter_t) :: parameter                                  !! in the document of the scene
      real(wp) :: typical = 1.0_wp                                    !! > 0, such as the length of its range
      logical :: is_tied = .false.                                    !! of a tone: all others keep their ratios to it
   end type moving_value_t

   !> Owner of outside resources: call `destroy`.
   type, extends(problem_t) :: scene_problem_t
      type(scene_t) :: scene                                          !! at the present value
      type(balance_t) :: balance                                      !! likewise
      type(document_t) :: document                                    !! likewise, but for frequencies
      integer :: own = 0                                              !! number of the moving value among the parameters
      integer, allocatable :: which(:)                                !! parameters that are unknown along a curve, the value last
      logical :: moves_frequency = .false.                            !! the value is that of a tone, and loads do not grow with it
      character(:), allocatable :: complaint                          !! why the last value was refused
      real(wp) :: refused = 0.0_wp                                    !! that value
      type(moving_value_t), private :: moving
      character(:), allocatable, private :: group                     ! of the value, or `several`
      real(wp), private :: value = 0.0_wp                             ! the present one
      real(wp), allocatable, private :: omega_at_zero(:), omega_slopes(:)  ! base frequencies as functions of the value
      real(wp), allocatable, private :: ratios(:)                     ! of tones to the value, where it moves more than tones
      real(wp), allocatable, private :: omega(:), xi(:)               ! the present ones, (n_tones)
      logical, private :: has_stiffness = .false.
      real(wp), private :: available_memory = huge(1.0_wp)            ! bytes
      logical, private :: is_sound = .false.                          ! scene and balance belong to the value
   contains
      procedure :: residual => scene_problem_residual
      procedure :: tangent => scene_problem_tangent
      procedure :: linearise => scene_problem_linearise
      procedure :: apply_tangent => scene_problem_apply_tangent
      procedure :: update_preconditioner => scene_problem_update_preconditioner
      procedure :: precondition => scene_problem_precondition
      procedure :: update_regular_preconditioner => scene_problem_update_regular_preconditioner
      procedure :: solve_linear => scene_problem_solve_linear
      procedure :: rounding_level => scene_problem_rounding_level
      procedure :: deform => scene_problem_deform
      procedure :: parameters => scene_problem_parameters
      procedure :: parameter_scales => scene_problem_parameter_scales
      procedure :: set_parameters => scene_problem_set_parameters
      procedure :: move => scene_problem_move
      procedure :: parameter_derivative => scene_problem_parameter_derivative
      procedure :: renew => scene_problem_renew
      procedure :: unevenness => scene_problem_unevenness
      procedure :: destroy => scene_problem_destroy
   end type scene_problem_t

contains

   !> Problem of a scene as its document has it. Fails for a value of a group that cannot move, and for a scene without laws.
   subroutine new_scene_problem(self, scene, document, moving, value, available_memory, error)
      type(scene_problem_t), intent(inout) :: self
      type(scene_t), intent(in) :: scene
      type(document_t), intent(in) :: document                        !! from which the scene was read
      type(moving_value_t), intent(in) :: moving
      real(wp), intent(in) :: value                                   !! that it has in the scene
      real(wp), intent(in) :: available_memory                        !! bytes
      type(error_t), allocatable, intent(out) :: error
      integer :: tone

      self%scene = scene
      self%document = document
      self%moving = moving
      self%value = value
      self%available_memory = available_memory
      self%own = 2*scene%tones%n_tones + 1
      self%n_unknowns = 0
      self%has_stiffness = .false.
      self%group = self%document%groups%holders(moving%parameter%i_group)%group%name
      if (document%drives(moving%parameter)) self%group = several
      self%moves_frequency = self%group == "tones" .and. .not. scene%has_inertia_loads
      self%omega_slopes = 0.0_wp*scene%tones%omega
      self%xi = self%omega_slopes
      self%omega = scene%tones%omega
      self%omega_at_zero = scene%tones%omega
      if (self%group == "tones") then
         tone = max(1, moving%parameter%element(1))
         self%omega_slopes(tone) = merge(two_pi, 1.0_wp, moving%parameter%key == "hertz")/scene%tones%subharmonic
         self%omega_at_zero(tone) = 0.0_wp
         if (moving%is_tied) then
            self%omega_slopes = self%omega_slopes(tone)*(scene%tones%omega/scene%tones%omega(tone))
            self%omega_at_zero = 0.0_wp
         end if
      else if (moving%is_tied) then
         self%ratios = scene%tones%omega/scene%tones%omega(max(1, moving%parameter%element(1)))
      end if
      call rebuild(self, error)
   end subroutine new_scene_problem

   !> Makes stiffness and balance of the scene anew; the stiffness stays where nothing but laws have changed.
   subroutine rebuild(self, error)
      type(scene_problem_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(coordinates_t) :: coordinates
      type(dynamic_stiffness_t) :: stiffness
      logical :: has_slopes, keeps_stiffness

      self%is_sound = .false.
      has_slopes = self%group == "tones" .or. any(self%scene%tones%is_unknown)
      associate (scene => self%scene)
         if (size(scene%laws) == 0) then
            call fail(error, "a curve needs at least one &law; without any, a &sweep shows all there is")
            return
         end if
         coordinates = coordinates_of(scene)
         keeps_stiffness = self%group == "law" .and. self%has_stiffness
         if (keeps_stiffness) keeps_stiffness = coordinates%equal(self%balance%stiffness%coordinates)
         if (keeps_stiffness) then
            call self%balance%stiffness%hand_over(stiffness)
         else
            call new_dynamic_stiffness(stiffness, scene%structure, coordinates, &
               scene%harmonics%frequencies(scene%tones%omega), scene%loads, error, &
               wanted_slopes_t(is_on=has_slopes, loads=scene%load_slopes))
            if (allocated(error)) return
         end if
         call new_balance(self%balance, scene%harmonics, scene%torus, scene%tones%omega, stiffness, &
                          laws_at(coordinates, scene%laws), scene%planning, error)
      end associate
      self%has_stiffness = .not. allocated(error)
      if (allocated(error)) return
      if (self%n_unknowns > 0 .and. self%n_unknowns /= self%balance%n_unknowns) then
         call fail(error, "the number of unknowns must not change along a curve")
         return
      end if
      self%n_unknowns = self%balance%n_unknowns
      self%has_products = self%balance%has_products
      self%largest_dense = self%balance%largest_dense
      self%x_scale = self%balance%x_scale
      self%r_scale = self%balance%r_scale
      self%residual_work = self%balance%residual_work
      self%tangent_work = self%balance%tangent_work
      self%preconditioner_work = self%balance%preconditioner_work
      if (any(abs(self%xi) > 0.0_wp)) call self%balance%move(self%scene%tones%omega, self%xi, error)
      self%is_sound = .not. allocated(error)
   end subroutine rebuild

   !> Makes the balance anew where it stands, so that its scales do not depend on the way there.
   subroutine scene_problem_renew(self)
      class(scene_problem_t), intent(inout) :: self
      type(error_t), allocatable :: error

      if (self%moves_frequency) return                                ! they never change
      call rebuild(self, error)
   end subroutine scene_problem_renew

   !> How far from smooth the residual is in the base frequencies: what it changes by where these change in their last digits. The
   !> condensed stiffness of a beam of 200 elements, whose condition is 1e11, has other rounding errors at each frequency.
   real(wp) function scene_problem_unevenness(self, x) result(change)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), parameter :: nearby = 16.0_wp*epsilon(1.0_wp)         ! relative
      real(wp), dimension(size(x)) :: here, there
      real(wp) :: omega(size(self%omega))
      integer :: i, k
      logical :: is_possible

      change = 0.0_wp
      if (self%scene%structure%n_dofs <= self%balance%n_dofs) return  ! nothing is condensed
      if (self%group /= "tones" .and. .not. any(self%scene%tones%is_unknown)) return
      omega = self%balance%omega
      call self%balance%residual(x, here)
      do k = -1, 1, 2
         call self%balance%set_parameters([(i, i=1, size(omega))], (1.0_wp + k*nearby)*omega, is_possible)
         if (.not. is_possible) exit
         call self%balance%residual(x, there)
         change = max(change, self%norm(there - here))
      end do
      call self%balance%set_parameters([(i, i=1, size(omega))], omega, is_possible)
   end function scene_problem_unevenness

   !> Brings scene and balance to a value; `complaint` tells why that is not possible.
   subroutine move_to(self, value, is_possible)
      type(scene_problem_t), intent(inout) :: self
      real(wp), intent(in) :: value
      logical, intent(out) :: is_possible
      type(error_t), allocatable :: error
      type(scene_t) :: before, fresh
      integer :: i
      logical :: is_new

      is_possible = .true.
      if (self%is_sound .and. abs(value - self%value) <= 0.0_wp) return
      self%value = value
      self%is_sound = .false.
      if (self%group == "tones") then
         associate (omega => self%omega_at_zero + self%omega_slopes*value, tones => self%scene%tones)
            is_possible = all(omega > 0.0_wp)
            if (.not. is_possible) then
               self%complaint = "frequencies must be greater than 0"
               self%refused = value
               return
            end if
            where (.not. tones%is_unknown) tones%omega = omega
            self%omega = tones%omega
         end associate
         if (self%scene%has_inertia_loads) then
            call self%document%begin()
            call read_loads(self%scene, self%document)
            call rebuild(self, error)
         else
            call self%balance%set_parameters([(i, i=1, size(self%omega_slopes))], self%scene%tones%omega, is_possible)
            if (.not. is_possible) self%complaint = "the structure has no condensed stiffness at these frequencies"
            if (.not. is_possible) self%refused = value
         end if
      else
         call set_value(self, value)
         if (self%scene%accuracy%is_on) before = self%scene
         call update_scene(self%scene, self%document, is_new, error, self%available_memory)
         if (is_new .and. before%accuracy%is_on .and. .not. allocated(error)) then   ! on the set that was chosen
            self%scene%certificate = before%certificate
            fresh = self%scene
            call put_on_rung(self%scene, fresh, rung_t(before%harmonics, before%torus%n_samples), error)
         end if
         if (.not. allocated(error)) then
            where (self%scene%tones%is_unknown) self%scene%tones%omega = self%omega   ! they are where they were
            self%omega = self%scene%tones%omega
         end if
         if (.not. allocated(error)) call rebuild(self, error)
         if (allocated(error) .and. before%accuracy%is_on) then       ! a value that is refused leaves the set that was chosen
            self%scene = before
            self%scene%is_read = .false.
         end if
      end if
      if (allocated(error)) then
         is_possible = .false.
         self%complaint = error%message
         self%refused = value
      end if
      self%is_sound = is_possible
   end subroutine move_to

   !> Sets the value in the document, with the tones that keep their ratios to it.
   subroutine set_value(self, value)
      type(scene_problem_t), intent(inout) :: self
      real(wp), intent(in) :: value
      type(parameter_t) :: tone
      integer :: i

      call self%document%set(self%moving%parameter, value)
      if (.not. allocated(self%ratios)) return
      tone = self%moving%parameter
      do i = 1, size(self%ratios)
         tone%element(1) = i
         call self%document%set(tone, self%ratios(i)*value)
      end do
   end subroutine set_value

   pure function scene_problem_parameters(self, which) result(values)
      class(scene_problem_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: values(size(which))

      values = self%balance%parameters(merge(1, which, which == self%own))
      where (which == self%own) values = self%value
   end function scene_problem_parameters

   pure function scene_problem_parameter_scales(self, which) result(scales)
      class(scene_problem_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: scales(size(which))

      scales = self%balance%parameter_scales(merge(1, which, which == self%own))
      where (which == self%own) scales = self%moving%typical
   end function scene_problem_parameter_scales

   subroutine scene_problem_set_parameters(self, which, values, is_possible)
      class(scene_problem_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: is_possible
      integer :: i

      is_possible = .true.
      i = findloc(which, self%own, dim=1)
      if (i > 0) call move_to(self, values(i), is_possible)
      if (is_possible .and. any(which /= self%own)) &
         call self%balance%set_parameters(pack(which, which /= self%own), pack(values, which /= self%own), is_possible)
      if (.not. is_possible .or. all(which == self%own)) return
      self%omega = self%balance%omega                                 ! from where a balance is made anew
      self%scene%tones%omega = self%omega
      self%xi = self%balance%xi
   end subroutine scene_problem_set_parameters

   !> Moves to the parameters of a point of a curve.
   subroutine scene_problem_move(self, x, is_possible)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! unknowns, then the parameters `which`
      logical, intent(out) :: is_possible

      call self%set_parameters(self%which, x(self%n_unknowns + 1:), is_possible)
   end subroutine scene_problem_move

   subroutine scene_problem_parameter_derivative(self, x, which, derivative)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      integer, intent(in) :: which
      real(wp), intent(out), contiguous :: derivative(:)
      real(wp) :: other(size(x)), step, value
      integer :: tone
      logical :: is_possible(3)

      if (which /= self%own) then
         call self%balance%parameter_derivative(x, which, derivative)
         return
      end if
      derivative = 0.0_wp
      if (self%group == "tones") then
         do tone = 1, size(self%omega_slopes)
            if (abs(self%omega_slopes(tone)) <= 0.0_wp) cycle
            call self%balance%parameter_derivative(x, tone, other)
            derivative = derivative + self%omega_slopes(tone)*other
         end do
         return
      end if
      value = self%value
      step = self%moving%typical*merge(1.0_wp, apart, self%group == "load" .and. .not. self%balance%law_set%needs_reaction)
      call move_to(self, value + step, is_possible(1))
      if (is_possible(1)) call self%balance%residual(x, derivative)
      call move_to(self, value - step, is_possible(2))
      if (is_possible(2)) call self%balance%residual(x, other)
      call move_to(self, value, is_possible(3))
      if (all(is_possible)) then
         derivative = (derivative - other)/(2.0_wp*step)
      else if (is_possible(3) .and. any(is_possible)) then            ! at the end of the range of the value
         if (is_possible(1)) then
            call self%balance%residual(x, other)
            derivative = (derivative - other)/step
         else
            call self%balance%residual(x, derivative)
            derivative = (derivative - other)/step
         end if
      end if
   end subroutine scene_problem_parameter_derivative

   subroutine scene_problem_residual(self, x, r)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)

      call self%balance%residual(x, r)
   end subroutine scene_problem_residual

   subroutine scene_problem_tangent(self, x, jacobian)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)

      call self%balance%tangent(x, jacobian)
      self%tangent_work = self%balance%tangent_work
   end subroutine scene_problem_tangent

   subroutine scene_problem_linearise(self, x, is_ready)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(out) :: is_ready

      call self%balance%linearise(x, is_ready)
   end subroutine scene_problem_linearise

   subroutine scene_problem_apply_tangent(self, x, product)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)

      call self%balance%apply_tangent(x, product)
   end subroutine scene_problem_apply_tangent

   subroutine scene_problem_update_preconditioner(self, level, is_strongest)
      class(scene_problem_t), intent(inout) :: self
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest

      call self%balance%update_preconditioner(level, is_strongest)
   end subroutine scene_problem_update_preconditioner

   subroutine scene_problem_update_regular_preconditioner(self, which, level, is_strongest)
      class(scene_problem_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest

      call self%balance%update_regular_preconditioner(pack(which, which /= self%own), level, is_strongest)
   end subroutine scene_problem_update_regular_preconditioner

   subroutine scene_problem_precondition(self, r, step)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      call self%balance%precondition(r, step)
   end subroutine scene_problem_precondition

   subroutine scene_problem_solve_linear(self, r, step)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      call self%balance%solve_linear(r, step)
   end subroutine scene_problem_solve_linear

   real(wp) function scene_problem_rounding_level(self, x) result(level)
      class(scene_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      level = self%balance%rounding_level(x)
   end function scene_problem_rounding_level

   subroutine scene_problem_deform(self, kind, amount)
      class(scene_problem_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

      call self%balance%deform(kind, amount)
   end subroutine scene_problem_deform

   !> Frees the balance; safe to call twice.
   subroutine scene_problem_destroy(self)
      class(scene_problem_t), intent(inout) :: self

      call self%balance%destroy()
   end subroutine scene_problem_destroy
end module hb_scene_problem
