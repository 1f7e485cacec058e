!> Rolling bearing: balls or rollers in a rotating cage. Each compressed ball exerts the Hertz force, f = k sum_i
!> d_i**n (cos a_i, sin a_i), d_i = max(x cos a_i + y sin a_i - c, 0), at the angles a_i = (j.tau + 2 pi i)/N. The
!> phase j.tau is that of the ball passage, N times that of the cage: the force is periodic in it. Source: S. Fukata,
!> E. Gad, T. Kondou, T. Ayabe and H. Tamura, Bull. JSME 28 (1985) 899; T. A. Harris, Rolling Bearing Analysis, Wiley
!> 2001; docs/why/theory.md, section 5.2. Sign: f stands beside K q on the left-hand side.
module hb_law_rolling_bearing
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_t, placement_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: rolling_bearing_t

   type, extends(law_t) :: rolling_bearing_t
      integer :: n_balls = 0                                          !! N
      real(wp) :: stiffness = 0.0_wp                                  !! k of one ball between both rings [N/m**n]
      real(wp) :: exponent = 1.5_wp                                   !! n
      real(wp) :: clearance = 0.0_wp                                  !! c, radial [m]; negative: preloaded at rest
      real(wp), allocatable, private :: angle(:)                      ! j.tau/N at the following samples
   contains
      procedure :: declare_numbers => rolling_bearing_declare_numbers
      procedure :: placement => rolling_bearing_placement
      procedure :: derive => rolling_bearing_derive
      procedure :: number_slope => rolling_bearing_number_slope
      procedure :: set_phases => rolling_bearing_set_phases
      procedure :: evaluate => rolling_bearing_evaluate
   end type rolling_bearing_t

contains

   subroutine rolling_bearing_declare_numbers(self, numbers)
      class(rolling_bearing_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("n_balls", self%n_balls)
      call numbers%add("stiffness", self%stiffness)
      call numbers%add("exponent", self%exponent)
      call numbers%add("clearance", self%clearance)
      call numbers%add("tuple", self%modulation)
   end subroutine rolling_bearing_declare_numbers

   pure function rolling_bearing_placement(self) result(placement)
      class(rolling_bearing_t), intent(in) :: self
      type(placement_t) :: placement

      placement%further(1) = "second_dofs"
   end function rolling_bearing_placement

   pure subroutine rolling_bearing_derive(self)
      class(rolling_bearing_t), intent(inout) :: self

      self%length_scale = abs(self%clearance)
      if (allocated(self%modulation)) self%n_phases = size(self%modulation)
   end subroutine rolling_bearing_derive

   pure subroutine rolling_bearing_set_phases(self, phases)
      class(rolling_bearing_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)
      real(wp) :: modulation(self%n_phases)

      modulation = real(self%modulation, wp)
      self%angle = matmul(modulation, phases(:self%n_phases, :))/self%n_balls
   end subroutine rolling_bearing_set_phases

   subroutine rolling_bearing_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(rolling_bearing_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp), dimension(size(z, 1)) :: approach, force, slope
      real(wp) :: direction(size(z, 1), 2)
      integer :: i, k

      f = 0.0_wp
      if (present(df_dz)) df_dz = 0.0_wp
      do i = 1, self%n_balls
         direction(:, 1) = cos(self%angle + two_pi*i/self%n_balls)
         direction(:, 2) = sin(self%angle + two_pi*i/self%n_balls)
         approach = max(sum(z*direction, dim=2) - self%clearance, 0.0_wp)
         force = self%stiffness*approach**self%exponent
         slope = self%stiffness*self%exponent*approach**(self%exponent - 1.0_wp)
         do k = 1, 2
            f(:, k) = f(:, k) + force*direction(:, k)
            if (present(df_dz)) df_dz(:, :, k) = df_dz(:, :, k) + spread(slope*direction(:, k), 2, 2)*direction
         end do
      end do
   end subroutine rolling_bearing_evaluate

   subroutine rolling_bearing_number_slope(self, number, z, v, p, slope, is_known)
      class(rolling_bearing_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp), dimension(size(z, 1)) :: approach, by_number
      real(wp) :: direction(size(z, 1), 2)
      integer :: i, j

      is_known = .true.
      slope = 0.0_wp
      associate (k => self%stiffness, n => self%exponent)
         do i = 1, self%n_balls
            direction(:, 1) = cos(self%angle + two_pi*i/self%n_balls)
            direction(:, 2) = sin(self%angle + two_pi*i/self%n_balls)
            approach = max(sum(z*direction, dim=2) - self%clearance, 0.0_wp)
            select case (number%key)
            case ("stiffness"); by_number = approach**n
            case ("exponent"); by_number = k*approach**n*log(max(approach, tiny(k)))
            case ("clearance"); by_number = -k*n*approach**(n - 1.0_wp)
            case default
               is_known = .false.
               return
            end select
            do j = 1, 2
               slope(:, j) = slope(:, j) + merge(by_number*direction(:, j), 0.0_wp, approach > 0.0_wp)
            end do
         end do
      end associate
   end subroutine rolling_bearing_number_slope
end module hb_law_rolling_bearing
