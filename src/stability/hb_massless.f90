!> Linearised equations of structures with degrees of freedom without mass: electrical circuits, filters, nodes between springs.
!>
!> With the degrees of freedom h with mass, l without mass but with damping, and s with neither, a disturbance of
!> M x'' + D x' + f = 0, f = K x, has the states x_h, x_l and v_h:
!>
!>     K_ss x_s = -(f_s without x_s),   D_ll x_l' = -(f_l + D_lh v_h),   M_hh v_h' = -(f_h + D_hh v_h + D_hl x_l').
!>
!> The other states are inert: they decay and affect nothing. Source: E. Hairer and G. Wanner, Solving Ordinary Differential
!> Equations II, Springer 1996, section VI.1 (index 1).
module hb_massless
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs, dpotrf, dpotrs
   use hb_law, only: law_box_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: massless_t, new_massless

   type :: massless_t
      logical, allocatable :: is_inert(:)                             !! (2 n_dofs), of the states (x, v)
      real(wp), allocatable :: stiffness(:, :), damping(:, :)         !! of the structure, (n_dofs, n_dofs)
      integer, allocatable, private :: heavy(:), light(:), still(:)   ! h, l and s
      real(wp), allocatable, private :: factor(:, :)                  ! of M_hh, by Cholesky
   contains
      procedure :: state_matrix => massless_state_matrix
   end type massless_t

contains

   !> Sorts the degrees of freedom. Fails if the mass of those that have one is singular.
   subroutine new_massless(self, structure, laws, error)
      type(massless_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)                          !! on its degrees of freedom
      type(error_t), allocatable, intent(out) :: error
      logical, dimension(structure%n_dofs) :: has_damping, has_mass
      integer :: i, info, n

      n = structure%n_dofs
      self%stiffness = structure%stiffness
      self%damping = structure%damping
      has_mass = any(abs(structure%mass) > 0.0_wp, dim=1) .or. any(abs(structure%mass) > 0.0_wp, dim=2)
      has_damping = any(abs(self%damping) > 0.0_wp, dim=1) .or. any(abs(self%damping) > 0.0_wp, dim=2)
      do i = 1, size(laws)
         if (laws(i)%law%needs_velocity) has_damping(laws(i)%law%dofs) = .true.
      end do
      self%heavy = pack([(i, i=1, n)], has_mass)
      self%light = pack([(i, i=1, n)], .not. has_mass .and. has_damping)
      self%still = pack([(i, i=1, n)], .not. (has_mass .or. has_damping))
      self%is_inert = [.not. (has_mass .or. has_damping), .not. has_mass]
      self%factor = structure%mass(self%heavy, self%heavy)
      if (size(self%heavy) == 0) return
      call dpotrf("L", size(self%heavy), self%factor, size(self%heavy), info)
      if (info /= 0) call fail(error, "the mass matrix is singular at "//trim(structure%labels(self%heavy(info))))
   end subroutine new_massless

   !> Rates of the states (x, v/scale, positions of sliders) by the states; NaN where D_ll or K_ss is singular.
   subroutine massless_state_matrix(self, scale, stiffness, damping, by_slider, a)
      class(massless_t), intent(in) :: self
      real(wp), intent(in) :: scale                                   !! [1/s]
      real(wp), intent(in) :: stiffness(:, :), damping(:, :)          !! with the slopes of laws, (n_dofs, n_dofs)
      real(wp), intent(in) :: by_slider(:, :)                         !! forces by positions of sliders, (n_dofs, n_sliders)
      real(wp), intent(out) :: a(:, :)                                !! (2 n_dofs + n_sliders, same)
      real(wp) :: f(size(stiffness, 1), size(a, 2))
      real(wp), allocatable :: rates(:, :)
      integer :: i, info, n

      n = size(stiffness, 1)
      f(:, :n) = stiffness
      f(:, n + 1:2*n) = 0.0_wp
      f(:, n + self%heavy) = scale*damping(:, self%heavy)
      f(:, 2*n + 1:) = by_slider
      a = 0.0_wp
      if (size(self%still) > 0) then
         rates = f(self%still, :)
         rates(:, self%still) = 0.0_wp
         call solve(stiffness(self%still, self%still), rates)         ! -x_s
         rates = matmul(f(:, self%still), rates)
         f(:, self%still) = 0.0_wp
         f = f - rates
      end if
      if (size(self%light) > 0) then
         rates = f(self%light, :)
         call solve(damping(self%light, self%light), rates)
         a(self%light, :) = -rates
         f(self%heavy, :) = f(self%heavy, :) - matmul(damping(self%heavy, self%light), rates)
      end if
      if (size(self%heavy) > 0) then
         rates = f(self%heavy, :)
         call dpotrs("L", size(rates, 1), size(rates, 2), self%factor, size(rates, 1), rates, size(rates, 1), info)
         a(n + self%heavy, :) = -rates/scale
      end if
      do i = 1, size(self%heavy)
         a(self%heavy(i), n + self%heavy(i)) = scale
      end do
      do i = 1, 2*n
         if (self%is_inert(i)) a(i, i) = -scale
      end do
   end subroutine massless_state_matrix

   !> Solves matrix x = b in place; NaN if the matrix is singular.
   subroutine solve(matrix, b)
      real(wp), intent(in) :: matrix(:, :)
      real(wp), intent(inout), contiguous :: b(:, :)
      real(wp) :: factors(size(matrix, 1), size(matrix, 1))
      integer :: info, n, pivots(size(matrix, 1))

      n = size(matrix, 1)
      factors = matrix
      call dgetrf(n, n, factors, n, pivots, info)
      if (info == 0) then
         call dgetrs("N", n, size(b, 2), factors, n, pivots, b, n, info)
      else
         b = ieee_value(1.0_wp, ieee_quiet_nan)
      end if
   end subroutine solve
end module hb_massless
