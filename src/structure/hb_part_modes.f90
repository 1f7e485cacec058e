!> Modes of a structure with parts whose stiffness depends on the frequency, such as delays: (lambda**2 M + lambda D + K +
!> sum of Z(lambda) a b^T) x = 0.
!>
!> Each mode without the parts is followed while they grow to their strength, by Newton's method for shape and lambda together.
!> Delays have any number of other modes: those that grow, or the first ones of equations of first order, which have none without
!> them, are sought from the frequencies at which the delayed force is a quarter of a period behind. Source: A. Ruhe, Algorithms
!> for the nonlinear eigenvalue problem, SIAM J. Numer. Anal. 10 (1973) 674-689, section 2.
module hb_part_modes
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: zgetrf, zgetrs
   use hb_modes, only: modes_t
   implicit none
   private
   public :: follow_parts

   integer, parameter :: max_modes = 40                               ! of the lowest frequencies: each takes some factorisations
   integer, parameter :: n_of_delay = 4                               ! modes that are sought for each delay
   integer, parameter :: n_steps = 8                                  ! of the strength of the parts
   integer, parameter :: max_iterations = 30
   real(wp), parameter :: iteration_tolerance = 1.0e-10_wp            ! of a last change, relative
   real(wp), parameter :: pi = 0.5_wp*two_pi
   real(wp), parameter :: max_gap = 1.0e-6_wp                         ! relative distance of equal modes

   !> The eigenvalue problem A(lambda) x = 0.
   type :: modes_problem_t
      real(wp), allocatable :: mass(:, :), damping(:, :), stiffness(:, :)
      type(frequency_part_t), allocatable :: parts(:)
   contains
      procedure :: converge => modes_problem_converge
   end type modes_problem_t

contains

   !> Replaces modes without the parts by those with them; modes that are lost, or become another one, are left out.
   subroutine follow_parts(modes, parts, mass, damping, stiffness)
      type(modes_t), intent(inout) :: modes                           !! in the order of their frequencies
      type(frequency_part_t), intent(in) :: parts(:)
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)
      type(modes_problem_t) :: problem
      complex(wp) :: lambda(min(max_modes, modes%n_modes) + n_of_delay*size(parts)), shape(size(mass, 1), size(lambda))
      real(wp) :: response(size(lambda))
      integer :: i, k, m, n_others
      logical :: is_found

      problem = modes_problem_t(mass, damping, stiffness, parts)
      k = 0
      do m = 1, min(max_modes, modes%n_modes)
         k = k + 1
         lambda(k) = cmplx(modes%growth(m), modes%frequency(m), wp)
         shape(:, k) = modes%shapes(:, m)
         do i = 1, n_steps
            call problem%converge(i/real(n_steps, wp), lambda(k), shape(:, k), response(k), is_found)
            if (.not. is_found) exit
         end do
         if (is_found) is_found = aimag(lambda(k)) > 0.0_wp .and. all(abs(lambda(:k - 1) - lambda(k)) > max_gap*abs(lambda(k)))
         if (.not. is_found) k = k - 1
      end do
      n_others = k
      do i = 1, size(parts)
         if (parts(i)%kind /= kind_of_part%delay .or. .not. parts(i)%delay > 0.0_wp) cycle
         do m = 1, n_of_delay
            k = k + 1
            lambda(k) = cmplx(0.0_wp, (m - 0.5_wp)*pi/parts(i)%delay, wp)
            call shape_by_force(problem, parts(i), lambda(k), shape(:, k), is_found)
            if (is_found) call problem%converge(1.0_wp, lambda(k), shape(:, k), response(k), is_found)
            if (is_found) is_found = aimag(lambda(k)) > max_gap*abs(lambda(k)) .and. &
               all(abs(lambda(:k - 1) - lambda(k)) > max_gap*abs(lambda(k))) .and. (n_others == 0 .or. real(lambda(k), wp) > 0.0_wp)
            if (.not. is_found) k = k - 1
         end do
      end do
      modes%n_modes = k
      modes%growth = real(lambda(:k), wp)
      modes%frequency = aimag(lambda(:k))
      modes%response = response(:k)
      modes%shapes = shape(:, :k)
      call sort_by_frequency(modes)
   end subroutine follow_parts

   !> Insertion sort: there are few.
   pure subroutine sort_by_frequency(modes)
      type(modes_t), intent(inout) :: modes
      integer :: i, m

      do i = 2, modes%n_modes
         do m = i, 2, -1
            if (modes%frequency(m) >= modes%frequency(m - 1)) exit
            modes%growth([m - 1, m]) = modes%growth([m, m - 1])
            modes%frequency([m - 1, m]) = modes%frequency([m, m - 1])
            modes%response([m - 1, m]) = modes%response([m, m - 1])
            modes%shapes(:, [m - 1, m]) = modes%shapes(:, [m, m - 1])
         end do
      end do
   end subroutine sort_by_frequency

   !> The motion under the force of a part.
   subroutine shape_by_force(self, part, eigenvalue, x, is_found)
      type(modes_problem_t), intent(in) :: self
      type(frequency_part_t), intent(in) :: part
      complex(wp), intent(in) :: eigenvalue
      complex(wp), intent(out) :: x(:)
      logical, intent(out) :: is_found
      complex(wp), dimension(size(x), size(x)) :: a, slope
      integer :: info, pivots(size(x))

      call assemble(self, 1.0_wp, eigenvalue, a, slope)
      x = part%acts
      call zgetrf(size(x), size(x), a, size(x), pivots, info)
      is_found = info == 0
      if (is_found) call zgetrs("N", size(x), 1, a, size(x), pivots, x, size(x), info)
   end subroutine shape_by_force

   !> Newton's method at a strength of the parts: A dx + A' x dlambda = -A x, with the largest component of the shape given.
   subroutine modes_problem_converge(self, strength, eigenvalue, x, response, is_converged)
      class(modes_problem_t), intent(in) :: self
      real(wp), intent(in) :: strength
      complex(wp), intent(inout) :: eigenvalue, x(:)
      real(wp), intent(out) :: response
      logical, intent(out) :: is_converged
      complex(wp), dimension(size(x), size(x)) :: a, slope
      complex(wp), dimension(size(x) + 1, size(x) + 1) :: bordered
      complex(wp) :: left(size(x) + 1), right(size(x) + 1)
      integer :: info, iteration, largest, n, pivots(size(x) + 1)

      n = size(x)
      response = 0.0_wp
      is_converged = .false.
      largest = maxloc(abs(x), dim=1)
      x = x/x(largest)
      do iteration = 1, max_iterations
         call assemble(self, strength, eigenvalue, a, slope)
         bordered = (0.0_wp, 0.0_wp)
         bordered(:n, :n) = a
         bordered(:n, n + 1) = matmul(slope, x)
         bordered(n + 1, largest) = (1.0_wp, 0.0_wp)
         right(:n) = -matmul(a, x)
         right(n + 1) = (0.0_wp, 0.0_wp)
         call zgetrf(n + 1, n + 1, bordered, n + 1, pivots, info)
         if (info /= 0) return
         call zgetrs("N", n + 1, 1, bordered, n + 1, pivots, right, n + 1, info)
         if (is_converged) exit                                    ! the factors are those of the mode
         x = x + right(:n)
         eigenvalue = eigenvalue + right(n + 1)
         if (.not. abs(eigenvalue) < huge(1.0_wp)) return
         is_converged = abs(right(n + 1)) <= iteration_tolerance*abs(eigenvalue)
      end do
      if (.not. is_converged) return
      left = (0.0_wp, 0.0_wp)
      left(n + 1) = (1.0_wp, 0.0_wp)
      call zgetrs("C", n + 1, 1, bordered, n + 1, pivots, left, n + 1, info)
      associate (y => left(:n))
         if (abs(dot_product(y, matmul(slope, x))) > 0.0_wp) &
            response = real(eigenvalue*dot_product(y, matmul(self%mass, x))/dot_product(y, matmul(slope, x)), wp)
      end associate
   end subroutine modes_problem_converge

   !> A and its derivative by lambda.
   subroutine assemble(self, strength, eigenvalue, a, slope)
      type(modes_problem_t), intent(in) :: self
      real(wp), intent(in) :: strength
      complex(wp), intent(in) :: eigenvalue
      complex(wp), intent(out) :: a(:, :), slope(:, :)
      complex(wp) :: z, dz
      integer :: j, k

      a = eigenvalue**2*self%mass + eigenvalue*self%damping + self%stiffness
      slope = 2.0_wp*eigenvalue*self%mass + self%damping
      do k = 1, size(self%parts)
         call self%parts(k)%evaluate_growing(eigenvalue, z, dz)
         do j = 1, size(a, 2)
            a(:, j) = a(:, j) + strength*z*self%parts(k)%acts*self%parts(k)%feels(j)
            slope(:, j) = slope(:, j) + strength*dz*self%parts(k)%acts*self%parts(k)%feels(j)
         end do
      end do
   end subroutine assemble
end module hb_part_modes
