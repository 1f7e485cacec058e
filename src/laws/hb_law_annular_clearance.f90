!> Rotor in a ring: f = N (e_r + s mu e_t), N = k max(0, r - clearance), r the distance of the rotor from the ring's centre.
!>
!> e_r points outwards, e_t = (-y, x)/r; s = 1 for a rotor that spins from x towards y, whose surface slides along e_t.
!> The spin is taken to outrun the whirl, so that friction never changes its direction.
!> Source: docs/theory.md, section 5.2. Sign: f stands beside K q on the left-hand side; on the rotor acts -f.
module hb_law_annular_clearance
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_dofs
   use hb_namelist, only: group_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: annular_clearance_t, new_annular_clearance

   character(8), parameter :: spin_names(2) = [character(8) :: "positive", "negative"]

   type, extends(law_t) :: annular_clearance_t
      real(wp) :: stiffness = 0.0_wp                                  !! k [N/m]
      real(wp) :: clearance = 0.0_wp                                  !! [m]
      real(wp) :: friction = 0.0_wp                                   !! s mu
      real(wp) :: center(2) = 0.0_wp                                  !! of the ring at rest [m]
   contains
      procedure :: read => annular_clearance_read
      procedure :: evaluate => annular_clearance_evaluate
      procedure :: length_scale => annular_clearance_length_scale
      procedure :: n_switches => annular_clearance_n_switches
      procedure :: switches => annular_clearance_switches
      procedure :: evaluate_held => annular_clearance_evaluate_held
      procedure :: is_odd => annular_clearance_is_odd
   end type annular_clearance_t

contains

   !> Ring of the given clearance round `center`; `friction` is the coefficient of friction, negative for a rotor that spins
   !> from y towards x.
   pure subroutine new_annular_clearance(self, stiffness, clearance, friction, center)
      class(annular_clearance_t), intent(inout) :: self
      real(wp), intent(in) :: stiffness                               !! [N/m], >= 0
      real(wp), intent(in) :: clearance                               !! [m], >= 0
      real(wp), intent(in) :: friction
      real(wp), intent(in) :: center(2)                               !! [m]

      self%stiffness = stiffness
      self%clearance = clearance
      self%friction = friction
      self%center = center
   end subroutine new_annular_clearance

   !> Reads a `&law type = 'annular_clearance'` group. `dofs` are x and y of the rotor, followed by x and y of the ring
   !> where that moves too.
   subroutine annular_clearance_read(self, group, structure)
      class(annular_clearance_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(:), allocatable :: spin
      real(wp), allocatable :: center(:)
      real(wp) :: clearance, friction, stiffness

      stiffness = 0.0_wp
      clearance = 0.0_wp
      friction = 0.0_wp
      spin = trim(spin_names(1))
      center = self%center
      call group%require("stiffness", stiffness, minimum=0.0_wp)
      call group%require("clearance", clearance, minimum=0.0_wp)
      call group%get("friction_coefficient", friction, minimum=0.0_wp)
      call group%get("spin", spin, choices=spin_names)
      call group%get("center", center, n=2)
      if (spin == spin_names(2)) friction = -friction
      if (size(center) == 2) call new_annular_clearance(self, stiffness, clearance, friction, center)
      call read_dofs(self, group, structure)
      if (.not. allocated(self%dofs)) return
      select case (size(self%dofs))
      case (2)
      case (4)
         self%shape = reshape([1.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, -1.0_wp], [4, 2])
      case default
         call group%problem("dofs", "name x and y of the rotor, or these and x and y of the ring")
      end select
   end subroutine annular_clearance_read

   subroutine annular_clearance_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: slope(2, 2)
      integer :: i

      do i = 1, size(z, 1)
         call at_sample(self, z(i, 1), z(i, 2), is_closed(self, z(i, :)), f(i, 1), f(i, 2), slope)
         if (present(df_dz)) df_dz(i, :, :) = slope
      end do
   end subroutine annular_clearance_evaluate

   pure logical function is_closed(self, z)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in) :: z(:)

      is_closed = hypot(z(1) - self%center(1), z(2) - self%center(2)) >= self%clearance
   end function is_closed

   !> f = secant T (x, y), T = ((1, -s mu), (s mu, 1)), secant = k (1 - clearance/r).
   pure subroutine at_sample(self, rotor_x, rotor_y, is_closed, force_x, force_y, slope)
      class(annular_clearance_t), intent(in) :: self
      real(wp), intent(in) :: rotor_x, rotor_y
      logical, intent(in) :: is_closed                                !! the rotor touches the ring
      real(wp), intent(out) :: force_x, force_y
      real(wp), intent(out) :: slope(2, 2)                            !! last axis: the coordinate differentiated by
      real(wp) :: r, ratio, secant, turned_x, turned_y, x, y

      x = rotor_x - self%center(1)
      y = rotor_y - self%center(2)
      r = hypot(x, y)
      force_x = 0.0_wp
      force_y = 0.0_wp
      slope = 0.0_wp
      if (.not. is_closed) return
      r = max(r, tiny(r))                                             ! r = 0 gets here without clearance only
      ratio = self%clearance/r
      secant = self%stiffness*(1.0_wp - ratio)
      turned_x = x - self%friction*y
      turned_y = y + self%friction*x
      force_x = secant*turned_x
      force_y = secant*turned_y
      ratio = self%stiffness*ratio
      slope(1, 1) = secant + ratio*(turned_x/r)*(x/r)
      slope(2, 1) = secant*self%friction + ratio*(turned_y/r)*(x/r)
      slope(1, 2) = -secant*self%friction + ratio*(turned_x/r)*(y/r)
      slope(2, 2) = secant + ratio*(turned_y/r)*(y/r)
   end subroutine at_sample

   pure real(wp) function annular_clearance_length_scale(self)
      class(annular_clearance_t), intent(in) :: self

      annular_clearance_length_scale = max(self%clearance, maxval(abs(self%center)))
   end function annular_clearance_length_scale

   pure integer function annular_clearance_n_switches(self)
      class(annular_clearance_t), intent(in) :: self

      annular_clearance_n_switches = merge(1, 0, self%clearance > 0.0_wp)
   end function annular_clearance_n_switches

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
      real(wp) :: slope(2, 2)

      call at_sample(self, z(1), z(2), all(is_positive), f(1), f(2), slope)
   end subroutine annular_clearance_evaluate_held

   !> Odd where the rotor hangs in the middle of the ring at rest.
   pure logical function annular_clearance_is_odd(self)
      class(annular_clearance_t), intent(in) :: self

      annular_clearance_is_odd = all(abs(self%center) <= 0.0_wp)
   end function annular_clearance_is_odd
end module hb_law_annular_clearance
