!> The tangent restricted to a few harmonics of all degrees of freedom, factorised: the part of the preconditioner with the
!> coupling of harmonics. Source: docs/why/theory.md, section 6.6.
!> Unknowns are ordered degree of freedom by degree of freedom, so that a narrow structure gives a band. Factors are in single
!> precision: iterations correct them, and time goes into reading them. Numbers below the range of that precision are zero:
!> processors take many times as long for gradual underflow, and slopes without kinks have such coefficients.
module hb_coarse_tangent
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_assert, only: assert, asserts_are_on
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_kinds, only: sp, wp
   use hb_lapack, only: sgbtrf, sgbtrs, sgetrf, sgetrs
   use hb_underflow, only: restore_underflow, underflow_to_zero
   implicit none
   private
   public :: coarse_tangent_t, factor_memory, factor_work, max_memory, new_coarse_tangent

   real(wp), parameter :: max_memory = 1.0e8_wp                      !! largest number of elements of the factors

   type :: coarse_tangent_t
      type(harmonics_t) :: set                                        !! of the selected harmonics
      integer, allocatable :: retained(:)                             !! (set%n_harmonics) their numbers in the full set
      logical :: is_usable = .false.                                  !! factorised and not singular
      integer, private :: n = 0                                       ! unknowns
      integer, private :: half_bandwidth = 0                          ! of the band
      real(sp), private :: unit = 0.0_sp                              ! of the entries [N/m], set by the first ones
      real(sp), allocatable, private :: matrix(:, :), rhs(:)
      integer, allocatable, private :: pivots(:)
      integer, allocatable, private :: positions(:)                   ! of its coefficients among those of the full set
   contains
      procedure :: clear => coarse_tangent_clear
      procedure :: add_alone => coarse_tangent_add_alone
      procedure :: add_column => coarse_tangent_add_column
      procedure :: factorise => coarse_tangent_factorise
      procedure :: n_factors => coarse_tangent_n_factors
      procedure :: solve => coarse_tangent_solve
   end type coarse_tangent_t

contains

   !> Allocates memory for the harmonics `retained` of `full`, in ascending order, of `n_dofs` degrees of freedom with
   !> coupling within `half_bandwidth`.
   subroutine new_coarse_tangent(self, full, retained, n_dofs, half_bandwidth)
      type(coarse_tangent_t), intent(out) :: self
      type(harmonics_t), intent(in) :: full
      integer, intent(in) :: retained(:), n_dofs, half_bandwidth
      type(error_t), allocatable :: error

      if (asserts_are_on) call assert(all(retained(2:) > retained(:size(retained) - 1)), "new_coarse_tangent", &
                                      "ascending harmonics")
      self%retained = retained
      call new_harmonics(self%set, full%tuples(:, retained), error)   ! cannot fail: part of an existing set
      self%positions = [full%indices_of(self%set, 1)]
      self%n = self%set%n_coefficients*n_dofs
      self%half_bandwidth = (half_bandwidth + 1)*self%set%n_coefficients - 1
      if (is_banded(self)) then
         allocate (self%matrix(3*self%half_bandwidth + 1, self%n))
      else
         allocate (self%matrix(self%n, self%n))
      end if
      allocate (self%rhs(self%n), self%pivots(self%n))
   end subroutine new_coarse_tangent

   pure logical function is_banded(self)
      type(coarse_tangent_t), intent(in) :: self

      is_banded = 2*(3*self%half_bandwidth + 1) <= self%n
   end function is_banded

   !> Multiplications and additions of the factorisation for `n_coefficients` of `n_dofs` degrees of freedom.
   pure real(wp) function factor_work(n_coefficients, n_dofs, half_bandwidth)
      integer, intent(in) :: n_coefficients, n_dofs
      integer, intent(in) :: half_bandwidth                           !! between coupled degrees of freedom
      real(wp) :: band, n

      n = real(n_coefficients, wp)*n_dofs
      band = real(half_bandwidth + 1, wp)*n_coefficients
      factor_work = 2.0_wp/3.0_wp*n**3
      if (6*band <= n) factor_work = 4*n*band**2
   end function factor_work

   !> Number of elements of these factors.
   pure real(wp) function factor_memory(n_coefficients, n_dofs, half_bandwidth)
      integer, intent(in) :: n_coefficients, n_dofs, half_bandwidth
      real(wp) :: band, n

      n = real(n_coefficients, wp)*n_dofs
      band = real(half_bandwidth + 1, wp)*n_coefficients
      factor_memory = min(n, 3*band)*n
   end function factor_memory

   !> Sets all entries to zero.
   subroutine coarse_tangent_clear(self)
      class(coarse_tangent_t), intent(inout) :: self

      self%matrix = 0.0_sp
      self%unit = 0.0_sp
      self%is_usable = .false.
   end subroutine coarse_tangent_clear

   !> Adds what multiplies each harmonic by itself to the block between degrees of freedom i (rows) and k (columns).
   subroutine coarse_tangent_add_alone(self, i, k, stiffness)
      class(coarse_tangent_t), intent(inout) :: self
      integer, intent(in) :: i, k
      complex(wp), intent(in) :: stiffness(:)                         !! [N/m], (n_harmonics) of `set`
      integer :: h
      logical :: was_gradual

      call set_unit(self, max(maxval(abs(real(stiffness))), maxval(abs(aimag(stiffness)))))
      if (.not. self%unit > 0.0_sp) return
      call underflow_to_zero(was_gradual)
      do h = 1, self%set%n_harmonics
         associate (a => self%set%cos_at(h), b => self%set%sin_at(h))
            call add_entry(a, a, real(stiffness(h)))
            if (b == 0) cycle
            call add_entry(a, b, aimag(stiffness(h)))
            call add_entry(b, a, -aimag(stiffness(h)))
            call add_entry(b, b, real(stiffness(h)))
         end associate
      end do
      call restore_underflow(was_gradual)

   contains

      subroutine add_entry(row, column, value)
         integer, intent(in) :: row, column                           ! in the block
         real(wp), intent(in) :: value                                ! [N/m]
         integer :: at

         at = above(self, i, k, column) + row
         associate (entry => self%matrix(at, (k - 1)*self%set%n_coefficients + column))
            entry = entry + real(value/self%unit, sp)
         end associate
      end subroutine add_entry
   end subroutine coarse_tangent_add_alone

   !> Adds a column of the block between degrees of freedom i (rows) and k (columns).
   subroutine coarse_tangent_add_column(self, i, k, column, values)
      class(coarse_tangent_t), intent(inout) :: self
      integer, intent(in) :: i, k
      integer, intent(in) :: column                                   !! coefficient of `set`
      real(wp), intent(in) :: values(:)                               !! [N/m], (n_coefficients) of `set`
      integer :: m, row
      logical :: was_gradual

      call set_unit(self, maxval(abs(values)))
      if (.not. self%unit > 0.0_sp) return
      call underflow_to_zero(was_gradual)
      m = self%set%n_coefficients
      row = above(self, i, k, column)
      associate (entries => self%matrix(row + 1:row + m, (k - 1)*m + column))
         entries = entries + real(values/self%unit, sp)
      end associate
      call restore_underflow(was_gradual)
   end subroutine coarse_tangent_add_column

   !> Rows of the stored matrix above a block in one of its columns.
   pure integer function above(self, i, k, column)
      type(coarse_tangent_t), intent(in) :: self
      integer, intent(in) :: i, k, column                             !! in the block (i, k)

      above = (i - 1)*self%set%n_coefficients
      if (is_banded(self)) above = above + 2*self%half_bandwidth + 1 - ((k - 1)*self%set%n_coefficients + column)
   end function above

   !> Sets the unit of the entries by the first ones that are not zero.
   pure subroutine set_unit(self, largest)
      type(coarse_tangent_t), intent(inout) :: self
      real(wp), intent(in) :: largest                                 !! of the entries [N/m]
      real(wp), parameter :: min_stiffness = 1.0e-30_wp               ! of a unit in this precision [N/m]

      if (self%unit > 0.0_sp .or. .not. largest > 0.0_wp) return
      self%unit = real(min(max(largest, min_stiffness), 1.0_wp/min_stiffness), sp)
   end subroutine set_unit

   !> Factorises the sum.
   subroutine coarse_tangent_factorise(self)
      class(coarse_tangent_t), intent(inout) :: self
      integer :: info
      logical :: was_gradual

      if (.not. all(ieee_is_finite(self%matrix))) return              ! NaN must not reach LAPACK if exceptions stop it
      call underflow_to_zero(was_gradual)
      if (is_banded(self)) then
         call sgbtrf(self%n, self%n, self%half_bandwidth, self%half_bandwidth, self%matrix, size(self%matrix, 1), self%pivots, info)
      else
         call sgetrf(self%n, self%n, self%matrix, self%n, self%pivots, info)
      end if
      call restore_underflow(was_gradual)
      self%is_usable = info == 0
   end subroutine coarse_tangent_factorise

   !> Number of stored entries of the factors.
   pure integer function coarse_tangent_n_factors(self) result(n_factors)
      class(coarse_tangent_t), intent(in) :: self

      n_factors = size(self%matrix)
   end function coarse_tangent_n_factors

   !> Writes the solution for the selected harmonics of r into step.
   subroutine coarse_tangent_solve(self, r, step)
      class(coarse_tangent_t), intent(inout) :: self
      real(wp), intent(in) :: r(:, :)                                 !! (n_coefficients of the full set, n_dofs)
      real(wp), intent(inout) :: step(:, :)                           !! as r; other harmonics are unchanged
      integer :: i, info, m
      logical :: was_gradual
      real(wp) :: largest

      call underflow_to_zero(was_gradual)
      largest = maxval(abs(r(self%positions, :)))
      if (.not. largest > 0.0_wp) largest = 1.0_wp
      m = size(self%positions)
      do i = 1, size(r, 2)
         self%rhs((i - 1)*m + 1:i*m) = real(r(self%positions, i)/largest, sp)
      end do
      if (is_banded(self)) then
         call sgbtrs("N", self%n, self%half_bandwidth, self%half_bandwidth, 1, self%matrix, size(self%matrix, 1), self%pivots, &
                     self%rhs, self%n, info)
      else
         call sgetrs("N", self%n, 1, self%matrix, self%n, self%pivots, self%rhs, self%n, info)
      end if
      do i = 1, size(r, 2)
         step(self%positions, i) = (largest/self%unit)*self%rhs((i - 1)*m + 1:i*m)
      end do
      call restore_underflow(was_gradual)
   end subroutine coarse_tangent_solve
end module hb_coarse_tangent
