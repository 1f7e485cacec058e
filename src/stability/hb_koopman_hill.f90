!> Hill's problem without its eigenvalues: the solution of x' = A(t) x for disturbances, from products of x with
!> harmonics of the motion.
!>
!> With A a series in the phases tau = omega t, the products x cos(k.tau) and x sin(k.tau) obey linear equations with
!> constant coefficients, y' = H y, whose matrix is that of Hill. The part k = 0 of the solution exp(H t) y(0) is
!> x(t), so that no eigenvalue of H has to be selected. H is truncated at an order; the truncation affects k = 0 after
!> as many steps as the order, so that time is divided into parts short enough for that: all have the same matrix,
!> only the phases at their start differ. Source: F. Bayer and R. I. Leine, Sorting-free Hill-based stability analysis
!> of periodic solutions through Koopman analysis, Nonlinear Dynamics 111 (2023) 8439-8466. Here for any number of
!> tones, and with parts of a period.
module hb_koopman_hill
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t
   use hb_harmonics, only: canonical_sign, harmonics_t, new_box
   use hb_kinds, only: two_pi, wp
   use hb_matrix_exponential, only: count_exponential, exponential_of
   use hb_variation, only: variation_t
   implicit none
   private
   public :: hill_t, new_hill

   integer, parameter :: beyond = 6                                   ! order of H minus that of A
   integer, parameter :: fewest_parts = 4, most_parts = 1024          ! of an interval
   real(wp), parameter :: negligible = 1.0e-12_wp                     ! harmonic of A, relative to the largest

   !> The series of A and the matrix of Hill.
   type :: hill_t
      integer :: n = 0                                                !! rows of A
      logical :: is_too_large = .false.                               !! it would exceed the permitted work
      type(harmonics_t) :: set                                        !! of the products
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones)
      real(wp), allocatable :: matrix(:, :)                           !! H, (n*n_coefficients, n*n_coefficients)
      integer, private :: n_parts = 0                                 ! of an interval
      real(wp), allocatable, private :: part(:, :)                    ! rows of exp(H time) for k = 0, (n, n*n_coefficients)
      real(wp), allocatable, private :: whole(:, :)                   ! exp(H time)
   contains
      procedure :: prepare => hill_prepare
      procedure :: go_on => hill_go_on
      procedure :: transfer => hill_transfer
   end type hill_t

contains

   !> Creates Hill's problem of a motion whose laws are smooth. A has twice the order of the motion for a cubic law;
   !> negligible harmonics are omitted. Nothing is computed if a period of the slowest tone would exceed `work_limit`.
   subroutine new_hill(self, variation, work_limit, error)
      type(hill_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: work_limit                              !! in about a nanosecond
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: series
      real(wp), allocatable :: cosine(:, :, :), sine(:, :, :)
      integer :: h, order(size(variation%motion%omega))

      self%n = variation%size
      self%omega = variation%motion%omega
      order = 2*max(1, maxval(abs(variation%motion%tuples), dim=2))
      call new_box(series, order, .false., error)
      if (allocated(error)) return
      call find_series(variation, series, cosine, sine)
      do h = 1, series%n_harmonics
         if (is_negligible(h)) cosine(:, :, h) = 0.0_wp
         if (is_negligible(h)) sine(:, :, h) = 0.0_wp
      end do
      order = 0
      do h = 1, series%n_harmonics
         if (any(abs(cosine(:, :, h)) > 0.0_wp) .or. any(abs(sine(:, :, h)) > 0.0_wp)) &
            order = max(order, abs(series%tuples(:, h)))
      end do
      call new_box(self%set, order + beyond, .false., error)
      if (allocated(error)) return
      self%is_too_large = work_of(self) > work_limit
      if (.not. self%is_too_large) call fill(self, series, cosine, sine)

   contains

      logical function is_negligible(h)
         integer, intent(in) :: h

         is_negligible = max(maxval(abs(cosine(:, :, h))), maxval(abs(sine(:, :, h)))) <= negligible*maxval(abs(cosine))
      end function is_negligible
   end subroutine new_hill

   !> Work of the first two iterations of `transfer` over a period of the slowest tone.
   pure real(wp) function work_of(self) result(work)
      type(hill_t), intent(in) :: self
      real(wp) :: turn

      turn = two_pi*sum(self%set%highest*self%omega)/minval(self%omega)  ! of the fastest harmonic
      work = 2*count_exponential(self%n*self%set%n_coefficients, turn/fewest_parts)
   end function work_of

   !> Coefficients of A over the torus, by sums over a grid that does not alias them.
   subroutine find_series(variation, series, cosine, sine)
      type(variation_t), intent(inout) :: variation
      type(harmonics_t), intent(in) :: series
      real(wp), allocatable, intent(out) :: cosine(:, :, :), sine(:, :, :)   !! (n, n, n_harmonics)
      integer, parameter :: at_once = 256
      real(wp), allocatable :: a(:, :, :), phases(:, :)
      real(wp) :: angle, weight
      integer :: done, h, i, m, n, n_grid, n_samples(size(series%highest)), place

      n_samples = 4*series%highest + 2                                ! resolves even a quartic of the motion
      n_grid = product(n_samples)
      n = variation%size
      allocate (cosine(n, n, series%n_harmonics), sine(n, n, series%n_harmonics), source=0.0_wp)
      do done = 0, n_grid - 1, at_once
         if (work_is_over()) return
         allocate (phases(size(n_samples), min(at_once, n_grid - done)))
         do i = 1, size(phases, 2)
            place = done + i - 1
            do m = 1, size(n_samples)
               phases(m, i) = two_pi*modulo(place, n_samples(m))/n_samples(m)
               place = place/n_samples(m)
            end do
         end do
         allocate (a(n, n, size(phases, 2)))
         call variation%matrices(phases, a)
         do h = 1, series%n_harmonics
            weight = merge(1.0_wp, 2.0_wp, series%sin_at(h) == 0)/n_grid
            do i = 1, size(phases, 2)
               angle = dot_product(series%tuples(:, h), phases(:, i))
               cosine(:, :, h) = cosine(:, :, h) + weight*cos(angle)*a(:, :, i)
               sine(:, :, h) = sine(:, :, h) + weight*sin(angle)*a(:, :, i)
            end do
         end do
         deallocate (a, phases)
      end do
   end subroutine find_series

   !> H: cos l cos k = (cos(k - l) + cos(k + l))/2 and so on, and the rates of the harmonics themselves.
   subroutine fill(self, series, cosine, sine)
      type(hill_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: series
      real(wp), intent(in) :: cosine(:, :, :), sine(:, :, :)
      real(wp) :: frequency
      integer :: h, i, k, n

      n = self%n
      allocate (self%matrix(n*self%set%n_coefficients, n*self%set%n_coefficients), source=0.0_wp)
      associate (set => self%set)
         do k = 1, set%n_harmonics
            if (work_is_over()) return
            do h = 1, series%n_harmonics
               if (all(abs(cosine(:, :, h)) <= 0.0_wp) .and. all(abs(sine(:, :, h)) <= 0.0_wp)) cycle
               if (series%sin_at(h) == 0) then
                  call add(set%cos_at(k), set%cos_at(k), 1.0_wp, cosine(:, :, h))
                  call add(set%sin_at(k), set%sin_at(k), 1.0_wp, cosine(:, :, h))
               else
                  call couple(k, set%tuples(:, k) - series%tuples(:, h), -1.0_wp, cosine(:, :, h), sine(:, :, h))
                  call couple(k, set%tuples(:, k) + series%tuples(:, h), 1.0_wp, cosine(:, :, h), sine(:, :, h))
               end if
            end do
            if (set%sin_at(k) == 0) cycle
            frequency = dot_product(self%omega, real(set%tuples(:, k), wp))
            do i = 1, n
               self%matrix((set%cos_at(k) - 1)*n + i, (set%sin_at(k) - 1)*n + i) = &
                  self%matrix((set%cos_at(k) - 1)*n + i, (set%sin_at(k) - 1)*n + i) - frequency
               self%matrix((set%sin_at(k) - 1)*n + i, (set%cos_at(k) - 1)*n + i) = &
                  self%matrix((set%sin_at(k) - 1)*n + i, (set%cos_at(k) - 1)*n + i) + frequency
            end do
         end do
      end associate

   contains

      !> Coupling of harmonic k to k + l or k - l, whose side is 1 or -1.
      subroutine couple(k, tuple, side, by_cosine, by_sine)
         integer, intent(in) :: k, tuple(:)
         real(wp), intent(in) :: side, by_cosine(:, :), by_sine(:, :)
         integer :: other
         real(wp) :: turn

         other = self%set%index_of(tuple)
         if (other == 0) return
         turn = real(canonical_sign(tuple), wp)
         associate (set => self%set)
            call add(set%cos_at(k), set%cos_at(other), 0.5_wp, by_cosine)
            call add(set%cos_at(k), set%sin_at(other), 0.5_wp*side*turn, by_sine)
            call add(set%sin_at(k), set%sin_at(other), 0.5_wp*turn, by_cosine)
            call add(set%sin_at(k), set%cos_at(other), -0.5_wp*side, by_sine)
         end associate
      end subroutine couple

      subroutine add(row, column, factor, block)
         integer, intent(in) :: row, column
         real(wp), intent(in) :: factor, block(:, :)

         if (row == 0 .or. column == 0) return
         associate (r => (row - 1)*self%n, c => (column - 1)*self%n)
            self%matrix(r + 1:r + self%n, c + 1:c + self%n) = self%matrix(r + 1:r + self%n, c + 1:c + self%n) + factor*block
         end associate
      end subroutine add
   end subroutine fill

   !> Computes the data of `go_on` for parts of this length.
   subroutine hill_prepare(self, length)
      class(hill_t), intent(inout) :: self
      real(wp), intent(in) :: length                                  !! [s]

      if (.not. allocated(self%whole)) allocate (self%whole, mold=self%matrix)
      call exponential_of(length*self%matrix, self%whole)
      self%part = self%whole((self%set%cos_at(1) - 1)*self%n + 1:self%set%cos_at(1)*self%n, :)
   end subroutine hill_prepare

   !> Propagates disturbances over the part that begins at these phases.
   subroutine hill_go_on(self, phases, x)
      class(hill_t), intent(in) :: self
      real(wp), intent(in) :: phases(:)                               !! [rad], (n_tones)
      real(wp), intent(inout) :: x(:, :)                              !! (n, any)
      real(wp) :: step(self%n, self%n)
      integer :: k

      step = 0.0_wp
      associate (set => self%set, n => self%n)
         do k = 1, set%n_harmonics
            associate (angle => dot_product(set%tuples(:, k), phases), a => set%cos_at(k), b => set%sin_at(k))
               step = step + cos(angle)*self%part(:, (a - 1)*n + 1:a*n)
               if (b > 0) step = step + sin(angle)*self%part(:, (b - 1)*n + 1:b*n)
            end associate
         end do
      end associate
      x = matmul(step, x)
   end subroutine hill_go_on

   !> Map of disturbances over an interval of time. Its parts are halved until the result does not change; subsequent
   !> intervals of the same length have as many.
   subroutine hill_transfer(self, start, length, tolerance, matrix, estimate)
      class(hill_t), intent(inout) :: self
      real(wp), intent(in) :: start, length                           !! [s]
      real(wp), intent(in) :: tolerance
      real(wp), allocatable, intent(out) :: matrix(:, :)
      real(wp), intent(inout) :: estimate                             !! of the error, from the first interval
      real(wp), allocatable :: before(:, :)

      if (self%n_parts > 0) then
         call take_parts()
         return
      end if
      estimate = huge(1.0_wp)
      self%n_parts = fewest_parts
      do
         call self%prepare(length/self%n_parts)
         call take_parts()
         if (work_is_over()) then
            estimate = huge(1.0_wp)
            exit
         end if
         if (allocated(before)) estimate = maxval(abs(matrix - before))/max(1.0_wp, maxval(abs(matrix)))
         if (estimate <= tolerance .or. self%n_parts >= most_parts) exit
         self%n_parts = 2*self%n_parts
         call move_alloc(matrix, before)
      end do

   contains

      subroutine take_parts()
         integer :: i

         allocate (matrix(self%n, self%n), source=0.0_wp)
         do i = 1, self%n
            matrix(i, i) = 1.0_wp
         end do
         do i = 0, self%n_parts - 1
            call self%go_on(self%omega*(start + i*length/self%n_parts), matrix)
         end do
      end subroutine take_parts
   end subroutine hill_transfer
end module hb_koopman_hill
