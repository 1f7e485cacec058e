!> Rotor in a ring: f = N (e_r + s mu e_t), N = k max(0, r - clearance), r the distance of the rotor from the ring's centre.
!>
!> e_r points outwards, e_t = (-y, x)/r; s = 1 for a rotor that spins from x towards y, whose surface slides along
!> e_t. The spin is assumed to be faster than the whirl, so that the direction of friction is fixed. If the radius R
!> and the speed Omega of the rotor are given, its surface slides at v_s = R Omega + e_t.v, and friction acts against
!> this: s mu = mu_0 tanh(v_s/v_0). A backward whirl is then not faster than rolling. Source: docs/why/theory.md,
!> section 5.2. Sign: f stands beside K q on the left-hand side; -f acts on the rotor.
module hb_law_annular_clearance
   use hb_kinds, only: wp
   use hb_law, only: law_t, placement_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: annular_clearance_t, new_annular_clearance

   type, extends(law_t) :: annular_clearance_t
      real(wp) :: stiffness = 0.0_wp                                  !! k [N/m]
      real(wp) :: clearance = 0.0_wp                                  !! [m]
      real(wp) :: friction_coefficient = 0.0_wp                       !! mu; negative: also reverses the direction
      logical :: spins_backwards = .false.                            !! from y towards x
      real(wp), allocatable :: center(:)                              !! of the ring at rest [m], (2)
      logical :: slides = .false.                                     !! friction depends on the velocity of sliding
      real(wp) :: rotor_radius = 0.0_wp                               !! R [m]
      real(wp) :: rotor_speed = 0.0_wp                                !! Omega [rad/s], from x towards y
      real(wp) :: slip_velocity = 0.0_wp                              !! v_0 [m/s]; 0: the direction of friction is fixed
      real(wp), private :: friction = 0.0_wp                          ! s mu
      real(wp), private :: surface_speed = 0.0_wp                     ! R Omega [m/s]
   contains
      procedure :: declare_numbers => annular_clearance_declare_numbers
      procedure :: placement => annular_clearance_placement
      procedure :: shape_on_dofs => annular_clearance_shape_on_dofs
      procedure :: derive => annular_clearance_derive
      procedure :: number_slope => annular_clearance_number_slope
      procedure :: evaluate => annular_clearance_evaluate
      procedure :: potential => annular_clearance_potential
      procedure :: switches => annular_clearance_switches
      procedure :: evaluate_held => annular_clearance_evaluate_held
   end type annular_clearance_t

contains

   !> Ring of the given clearance around `center`; `friction` is the coefficient of friction, negative for a rotor
   !> that spins from y towards x.
   pure subroutine new_annular_clearance(self, stiffness, clearance, friction, center)
      class(annular_clearance_t), intent(inout) :: self
      real(wp), intent(in) :: stiffness                               !! [N/m], >= 0
      real(wp), intent(in) :: clearance                               !! [m], >= 0
      real(wp), intent(in) :: friction
      real(wp), intent(in) :: center(2)                               !! [m]

      self%stiffness = stiffness
      self%clearance = clearance
      self%friction_coefficient = friction
      self%center = center
      call self%derive()
   end subroutine new_annular_clearance

   subroutine annular_clearance_declare_numbers(self, numbers)
      class(annular_clearance_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%note_given("rotor_radius", self%slides)
      call numbers%add("stiffness", self%stiffness)
      call numbers%add("clearance", self%clearance)
      call numbers%add("friction_coefficient", self%friction_coefficient)
      if (self%slides) then
         call numbers%add("rotor_radius", self%rotor_radius)
         call numbers%add("rotor_speed", self%rotor_speed)
         call numbers%add("slip_velocity", self%slip_velocity)
      end if
      call numbers%add("center", self%center, n=2)
      if (self%slides) then
         call numbers%reject("spin", "not beside 'rotor_radius': the sign of 'rotor_speed' gives the direction")
      else
         call numbers%add("spin", self%spins_backwards, word="negative")
         call numbers%reject("rotor_speed", "needs 'rotor_radius' and 'slip_velocity'")
         call numbers%reject("slip_velocity", "needs 'rotor_radius' and 'rotor_speed'")
      end if
   end subroutine annular_clearance_declare_numbers

   !> On x and y of the rotor, followed by x and y of the ring if it moves too.
   pure function annular_clearance_placement(self) result(placement)
      class(annular_clearance_t), intent(in) :: self
      type(placement_t) :: placement

      placement%is_by_dofs = .true.
      placement%counts = [2, 4]
      placement%dofs = "name x and y of the rotor, or these and x and y of the ring"
   end function annular_clearance_placement

   pure function annular_clearance_shape_on_dofs(self, n) result(shape)
      class(annular_clearance_t), intent(in) :: self
      integer, intent(in) :: n
      real(wp), allocatable :: shape(:, :)

      if (n == 4) then
         shape = reshape([1.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, -1.0_wp], [4, 2])
      else
         shape = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
      end if
   end function annular_clearance_shape_on_dofs

   pure subroutine annular_clearance_derive(self)
      class(annular_clearance_t), intent(inout) :: self

      if (.not. allocated(self%center)) self%center = [0.0_wp, 0.0_wp]
      self%friction = self%friction_coefficient
      if (self%spins_backwards) self%friction = -self%friction
      self%surface_speed = self%rotor_radius*self%rotor_speed
      self%needs_velocity = self%slides
      self%has_potential = .not. abs(self%friction) > 0.0_wp
      self%has_convex_free_region = .true.
      self%is_odd = all(abs(self%center) <= 0.0_wp)
      self%length_scale = max(self%clearance, maxval(abs(self%center)))
      self%n_switches = merge(1, 0, self%clearance > 0.0_wp)
   end subroutine annular_clearance_derive

   subroutine annular_clearance_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: by_v(2, 2), by_z(2, 2), rate(2)
      integer :: i

      rate = 0.0_wp
      do i = 1, size(z, 1)
         if (self%needs_velocity) rate = v(i, :)
         call at_sample(self, z(i, :), rate, is_closed(self, z(i, :)), f(i, :), by_z, by_v)
         if (present(df_dz)) df_dz(i, :, :) = by_z
         if (self%needs_velocity .and. present(df_dv)) df_dv(i, :, :) = by_v
      end do
   end subroutine annular_clearance_evaluate

   pure logical function is_closed(self, z)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in) :: z(:)

      is_closed = hypot(z(1) - self%center(1), z(2) - self%center(2)) >= self%clearance
   end function is_closed

   !> f = secant (z + m J z), J z = (-y, x), secant = k (1 - clearance/r), and m = s mu or mu_0 tanh(v_s/v_0).
   pure subroutine at_sample(self, position, rate, is_closed, f, df_dz, df_dv)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in) :: position(2), rate(2)
      logical, intent(in) :: is_closed                                !! the rotor touches the ring
      real(wp), intent(out) :: f(2)
      real(wp), intent(out) :: df_dz(2, 2), df_dv(2, 2)               !! last axis: the variable of differentiation
      real(wp) :: friction, r, ratio, secant, slope, tangent(2), turned(2), z(2)
      integer :: k

      f = 0.0_wp
      df_dz = 0.0_wp
      df_dv = 0.0_wp
      if (.not. is_closed) return
      z = position - self%center(1:2)
      r = max(hypot(z(1), z(2)), tiny(r))                             ! r = 0 occurs here only without clearance
      tangent = [-z(2), z(1)]/r
      friction = self%friction
      slope = 0.0_wp
      if (self%slip_velocity > 0.0_wp) then
         friction = tanh((self%surface_speed + dot_product(tangent, rate))/self%slip_velocity)
         slope = self%friction*(1.0_wp - friction**2)/self%slip_velocity
         friction = self%friction*friction
      end if
      ratio = self%clearance/r
      secant = self%stiffness*(1.0_wp - ratio)
      turned = [z(1) - friction*z(2), z(2) + friction*z(1)]
      f = secant*turned
      ratio = self%stiffness*ratio
      df_dz(:, 1) = secant*[1.0_wp, friction]
      df_dz(:, 2) = secant*[-friction, 1.0_wp]
      do k = 1, 2                                                     ! d(e_t)/dz = -e_r e_t^T/r
         df_dz(:, k) = df_dz(:, k) + ratio*(turned/r)*(z(k)/r) - secant*slope*dot_product(z/r, rate)*tangent*tangent(k)
         df_dv(:, k) = secant*r*slope*tangent*tangent(k)
      end do
   end subroutine at_sample

   !> By k the force is f/k; by the clearance -k (e_r + m e_t); by the center as by the opposite motion; by a number of
   !> friction secant dm J z.
   subroutine annular_clearance_number_slope(self, number, z, v, p, slope, is_known)
      class(annular_clearance_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: along, by_v(2, 2), by_z(2, 2), f(2), r, rate(2), secant, share, steepness, tangent(2), x(2)
      integer :: i

      is_known = .true.
      slope = 0.0_wp
      rate = 0.0_wp
      do i = 1, size(z, 1)
         if (.not. is_closed(self, z(i, :))) cycle
         if (self%needs_velocity) rate = v(i, :)
         call at_sample(self, z(i, :), rate, .true., f, by_z, by_v)
         x = z(i, :) - self%center(1:2)
         r = max(hypot(x(1), x(2)), tiny(r))
         tangent = [-x(2), x(1)]/r
         secant = self%stiffness*(r - self%clearance)                 ! the normal force
         share = 1.0_wp                                               ! m = friction times share
         steepness = 0.0_wp                                           ! its derivative by v_s/v_0
         along = 0.0_wp                                               ! v_s
         if (self%slip_velocity > 0.0_wp) then
            along = self%surface_speed + dot_product(tangent, rate)
            share = tanh(along/self%slip_velocity)
            steepness = (1.0_wp - share**2)/self%slip_velocity
         end if
         select case (number%key)
         case ("stiffness"); slope(i, :) = (r - self%clearance)*(x/r + self%friction*share*tangent)
         case ("clearance"); slope(i, :) = -self%stiffness*(x/r + self%friction*share*tangent)
         case ("friction_coefficient"); slope(i, :) = merge(-1.0_wp, 1.0_wp, self%spins_backwards)*secant*share*tangent
         case ("center"); slope(i, :) = -by_z(:, number%element(1))
         case ("rotor_radius"); slope(i, :) = secant*self%friction*steepness*self%rotor_speed*tangent
         case ("rotor_speed"); slope(i, :) = secant*self%friction*steepness*self%rotor_radius*tangent
         case ("slip_velocity"); slope(i, :) = -secant*self%friction*steepness*along/self%slip_velocity*tangent
         case default
            is_known = .false.
         end select
      end do
   end subroutine annular_clearance_number_slope

   pure subroutine annular_clearance_switches(self, z, v, values)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      if (size(values) > 0) values = hypot(z(1) - self%center(1), z(2) - self%center(2)) - self%clearance
   end subroutine annular_clearance_switches

   subroutine annular_clearance_evaluate_held(self, z, v, is_positive, f)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)
      real(wp) :: by_v(2, 2), by_z(2, 2), rate(2)

      rate = 0.0_wp
      if (self%needs_velocity) rate = v
      call at_sample(self, z, rate, all(is_positive), f, by_z, by_v)
   end subroutine annular_clearance_evaluate_held

   !> k max(r - clearance, 0)**2/2, without friction.
   subroutine annular_clearance_potential(self, z, energy, gradient)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: by_v(2, 2), by_z(2, 2)
      integer :: i

      do i = 1, size(z, 1)
         associate (r => hypot(z(i, 1) - self%center(1), z(i, 2) - self%center(2)))
            energy(i) = 0.5_wp*self%stiffness*max(r - self%clearance, 0.0_wp)**2
         end associate
         call at_sample(self, z(i, :), [0.0_wp, 0.0_wp], is_closed(self, z(i, :)), gradient(i, :), by_z, by_v)
      end do
   end subroutine annular_clearance_potential
end module hb_law_annular_clearance
