!> Times of the kernels of one model, each beside a physical yardstick measured in the same process.
!>
!> A repetition runs a kernel and its yardstick one after the other, so that what else the machine does hits both alike; the
!> ratio is the median over repetitions. Apart from that, the very first run of each is kept: nothing is planned, no memory is
!> warm. Yardsticks: the bare FFTW pair (spectrum to samples and back) of the same grid and batch (of the whole grid
!> where odd motions are solved on half of it), and LAPACK's LU factorisation of a full matrix of the same size.
module kernel_times
   use hb_balance, only: balance_t, new_balance
   use hb_clock, only: wall_clock
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_document, only: document_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_error, only: error_t
   use hb_fftw, only: complex_block_t, fft_plan_t, forget_plans, new_complex_block, new_fft_plan, new_real_block, real_block_t
   use hb_kinds, only: int64, wp
   use hb_lapack, only: dgetrf
   use hb_law_coordinates, only: laws_at
   use hb_model, only: model_t
   use hb_model_basis, only: find_basis
   use hb_model_reader, only: read_model
   use hb_motion, only: solve_motion
   use hb_motion_result, only: motion_result_t
   use hb_run_callbacks, only: run_callbacks
   use hb_solver, only: solve
   use hb_solver_types, only: report_t
   use hb_system, only: coordinates_of
   use hb_tangent_factor, only: new_tangent_factor, tangent_factor_t
   implicit none
   private
   public :: has_kernels, kernel, kernel_names, kernel_times_t, kernel_words, measure_kernels, median, memory_bandwidth, &
      yardstick_words

   !> What is measured; numbers as in the file.
   type :: kernel_t
      integer :: residual = 1                                         !! one residual, beside the FFT pair
      integer :: tangent = 2                                          !! assembly of the tangent, beside its LU
      integer :: newton_step = 3                                      !! tangent, LU, step and residual, beside the LU
      integer :: solution = 4                                         !! set-up and solution of the equations, beside the LU
      integer :: point = 5                                            !! the same with input, recovery and error estimate
   end type kernel_t
   type(kernel_t), parameter :: kernel = kernel_t()
   character(*), parameter :: kernel_names(5) = [character(11) :: "residual", "tangent", "newton_step", "solution", "point"]
   character(*), parameter :: kernel_words(5) = [character(56) :: "one residual", "assembly of the tangent", &
      "one Newton step: tangent, factorisation, step, residual", "set-up and solution of the equations", &
      "a whole point: input, solution, recovery, error estimate"]
   character(*), parameter, private :: lu = "LU factorisation of a full matrix of the same size"
   character(*), parameter :: yardstick_words(5) = [character(50) :: "bare pair of transforms", lu, lu, lu, lu]

   integer, parameter :: fewest = 5, most = 1001                       ! repetitions
   integer, parameter :: largest_matrix = 8000                        ! unknowns; beyond, nothing with a full matrix is timed
   real(wp), parameter :: shortest = 2.0e-4_wp                        ! seconds that one timing lasts at least

   real(wp), parameter :: unknown = transfer(int(z'7FF8000000000000', int64), 1.0_wp)   ! NaN, for what was not measured

   !> Times in seconds; NaN where something was not measured.
   type :: kernel_times_t
      integer :: n_unknowns = 0                                       !! 0: nothing to time
      integer :: n_samples = 0                                        !! of the whole grid
      integer :: n_channels = 0                                       !! degrees of freedom of the laws
      real(wp) :: seconds(size(kernel_names)) = unknown               !! median
      real(wp) :: first(size(kernel_names)) = unknown                 !! the first run, nothing planned
      real(wp) :: fastest(size(kernel_names)) = unknown
      real(wp) :: slowest(size(kernel_names)) = unknown
      real(wp) :: yardstick(size(kernel_names)) = unknown             !! median
      real(wp) :: ratio(size(kernel_names)) = unknown                 !! median of the ratios of each repetition
      real(wp) :: ratio_low(size(kernel_names)) = unknown             !! their lower quartile
      real(wp) :: ratio_high(size(kernel_names)) = unknown            !! their upper quartile
   end type kernel_times_t

   !> Everything that the timed pieces work on.
   type :: workshop_t
      type(document_t) :: document
      type(model_t) :: model
      type(balance_t) :: balance
      type(fft_plan_t) :: plan
      type(real_block_t) :: samples
      type(complex_block_t) :: spectrum
      type(tangent_factor_t) :: factor
      real(wp), allocatable :: u(:), r(:), step(:)                    ! at the solution
      real(wp), allocatable :: jacobian(:, :), matrix(:, :)
      integer, allocatable :: pivots(:)
      type(report_t) :: report
   end type workshop_t

contains

   !> Measures all kernels of the model in `document`, for about `budget` seconds each. A model without laws, or with unknown
   !> base frequencies, has none that could be timed by themselves.
   subroutine measure_kernels(self, document, budget, error)
      type(kernel_times_t), intent(out) :: self
      type(document_t), intent(in) :: document
      real(wp), intent(in) :: budget
      type(error_t), allocatable, intent(out) :: error
      type(workshop_t) :: shop
      integer :: i

      shop%document = document
      call read_fresh(shop%model, shop%document, error)
      if (allocated(error)) return
      if (size(shop%model%system%laws) == 0 .or. any(shop%model%system%tones%is_unknown)) return
      call run_first(self, shop, error)
      if (.not. allocated(error)) call set_up(shop, error)
      if (.not. allocated(error)) then
         self%n_unknowns = shop%balance%n_unknowns
         self%n_samples = shop%model%discretisation%torus%n_total
         self%n_channels = shop%balance%n_dofs
         do i = 1, size(kernel_names)
            call measure(self, shop, i, budget, error)
            if (allocated(error)) exit
         end do
      end if
      call shop%balance%destroy()
      call shop%plan%destroy()
      call shop%samples%destroy()
      call shop%spectrum%destroy()
   end subroutine measure_kernels

   !> Whether the model had kernels to time.
   pure logical function has_kernels(self)
      type(kernel_times_t), intent(in) :: self

      has_kernels = self%n_unknowns > 0
   end function has_kernels

   !> Times the first point and the first solution, each without any plan from before, and keeps the latter.
   subroutine run_first(self, shop, error)
      type(kernel_times_t), intent(inout) :: self
      type(workshop_t), intent(inout) :: shop
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: started

      call forget_plans()
      started = wall_clock()
      call run_point(shop, error)
      self%first(kernel%point) = wall_clock() - started
      if (allocated(error)) return
      call forget_plans()
      started = wall_clock()
      call make_balance(shop%model, shop%balance, error)
      if (allocated(error)) return
      allocate (shop%u(shop%balance%n_unknowns))
      call solve_balance(shop%model, shop%balance, shop%u, shop%report)
      self%first(kernel%solution) = wall_clock() - started
   end subroutine run_first

   !> Plans the yardsticks and makes room for what kernels leave.
   subroutine set_up(shop, error)
      type(workshop_t), intent(inout) :: shop
      type(error_t), allocatable, intent(out) :: error
      integer :: n

      n = shop%balance%n_unknowns
      allocate (shop%r(n), shop%step(n))
      associate (grid => shop%model%discretisation%torus, channels => shop%balance%n_dofs)
         call new_real_block(shop%samples, grid%n_total, channels, error)
         if (allocated(error)) return
         call new_complex_block(shop%spectrum, (grid%n_samples(1)/2 + 1)*product(grid%n_samples(2:)), channels, error)
         if (allocated(error)) return
         call new_fft_plan(shop%plan, grid%n_samples, channels, shop%samples%values, &
            shop%spectrum%values, error)
         if (allocated(error)) return
      end associate
      if (n > largest_matrix) return
      allocate (shop%jacobian(n, n), shop%matrix(n, n), shop%pivots(n))
      call new_tangent_factor(shop%factor, n)
      call shop%balance%tangent(shop%u, shop%jacobian)
   end subroutine set_up

   subroutine read_fresh(model, document, error)
      type(model_t), intent(out) :: model
      type(document_t), intent(in) :: document
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: copy

      copy = document
      call read_model(model, copy, error, callbacks=run_callbacks())
   end subroutine read_fresh

   !> The balance of what the laws of a model feel, as a point is solved.
   subroutine make_balance(model, balance, error)
      type(model_t), intent(in) :: model
      type(balance_t), intent(inout) :: balance
      type(error_t), allocatable, intent(out) :: error
      type(discretisation_t) :: basis
      type(coordinates_t) :: coordinates
      type(dynamic_stiffness_t) :: stiffness
      logical :: is_odd

      call find_basis(basis, is_odd, model%system, model%discretisation, model%options, error)
      if (allocated(error)) return
      coordinates = coordinates_of(model%system)
      call new_dynamic_stiffness(stiffness, model%system%structure, coordinates, &
                                 basis%harmonics%frequencies(model%system%tones%omega), &
         model%system%loads_in(basis%harmonics), error)
      if (.not. allocated(error)) call new_balance(balance, basis%harmonics, basis%torus, model%system%tones%omega, stiffness, &
         laws_at(coordinates, model%system%laws), error)
   end subroutine make_balance

   !> Solves from the first guess of the model.
   subroutine solve_balance(model, balance, x, report)
      type(model_t), intent(in) :: model
      type(balance_t), intent(inout) :: balance
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report
      real(wp) :: linear(size(x))

      call balance%linear_solution(linear)
      x = merge(1.0_wp, 0.0_wp, model%options%start%from_linear)*linear
      call solve(balance, model%options%solver, linear, x, report)
   end subroutine solve_balance

   !> Times kernel i and its yardstick until the budget is used.
   subroutine measure(self, shop, i, budget, error)
      type(kernel_times_t), intent(inout) :: self
      type(workshop_t), intent(inout) :: shop
      integer, intent(in) :: i
      real(wp), intent(in) :: budget
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: seconds(most), yardstick(most), started
      integer :: n, n_kernel, n_yardstick

      if (i /= kernel%residual .and. .not. allocated(shop%matrix)) then
         if (i == kernel%tangent .or. i == kernel%newton_step) return
      end if
      n_kernel = 1
      n_yardstick = 1
      n = 0
      started = wall_clock()
      do while (n < most)
         call time_yardstick(shop, i, n_yardstick, yardstick(n + 1))
         call time_kernel(shop, i, n_kernel, seconds(n + 1), error)
         if (allocated(error)) return
         if (self%first(i) /= self%first(i)) self%first(i) = seconds(1)
         if (n == 0 .and. enough(seconds(1), n_kernel) .and. enough(yardstick(1), n_yardstick)) then
            n = 1
         else if (n == 0) then
            if (.not. enough(seconds(1), n_kernel)) n_kernel = 2*n_kernel
            if (.not. enough(yardstick(1), n_yardstick)) n_yardstick = 2*n_yardstick
         else
            n = n + 1
         end if
         if (n >= fewest .and. wall_clock() - started > budget) exit
      end do
      n = min(n, most)
      self%seconds(i) = median(seconds(:n))
      self%fastest(i) = minval(seconds(:n))
      self%slowest(i) = maxval(seconds(:n))
      self%yardstick(i) = median(yardstick(:n))
      if (.not. self%yardstick(i) > 0.0_wp) then
         self%yardstick(i) = unknown
         return
      end if
      seconds(:n) = seconds(:n)/yardstick(:n)
      self%ratio(i) = median(seconds(:n))
      self%ratio_low(i) = median(pack(seconds(:n), seconds(:n) <= self%ratio(i)))
      self%ratio_high(i) = median(pack(seconds(:n), seconds(:n) >= self%ratio(i)))
   end subroutine measure

   !> Whether `times` runs of so many seconds each last long enough for the clock; a yardstick that does not exist does.
   pure logical function enough(seconds, times)
      real(wp), intent(in) :: seconds
      integer, intent(in) :: times

      enough = seconds*times >= shortest .or. seconds <= 0.0_wp
   end function enough

   !> Seconds of one run of kernel i, over `times` runs.
   subroutine time_kernel(shop, i, times, seconds, error)
      type(workshop_t), intent(inout) :: shop
      integer, intent(in) :: i, times
      real(wp), intent(out) :: seconds
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: started
      integer :: k

      started = wall_clock()
      do k = 1, times
         select case (i)
         case (kernel%residual)
            call shop%balance%residual(shop%u, shop%r)
         case (kernel%tangent)
            call shop%balance%tangent(shop%u, shop%jacobian)
         case (kernel%newton_step)
            call run_newton_step(shop)
         case (kernel%solution)
            call run_solution(shop, error)
         case default
            call run_point(shop, error)
         end select
         if (allocated(error)) return
      end do
      seconds = (wall_clock() - started)/times
   end subroutine time_kernel

   subroutine run_newton_step(shop)
      type(workshop_t), intent(inout) :: shop
      logical :: is_singular

      call shop%factor%update(shop%balance, shop%u, is_singular)
      shop%step = shop%r
      call shop%factor%solve(shop%balance, shop%step)
      call shop%balance%residual(shop%u, shop%r)
   end subroutine run_newton_step

   !> From the model to the coefficients of its laws, with nothing made beforehand.
   subroutine run_solution(shop, error)
      type(workshop_t), intent(inout) :: shop
      type(error_t), allocatable, intent(out) :: error
      type(balance_t) :: balance
      type(report_t) :: report

      call make_balance(shop%model, balance, error)
      if (.not. allocated(error)) call solve_balance(shop%model, balance, shop%step, report)
      call balance%destroy()
   end subroutine run_solution

   !> A whole point, as a sweep solves it.
   subroutine run_point(shop, error)
      type(workshop_t), intent(inout) :: shop
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: model
      type(motion_result_t) :: result

      call read_fresh(model, shop%document, error)
      if (.not. allocated(error)) call solve_motion(model, result, error)
   end subroutine run_point

   !> Seconds of the yardstick of kernel i, over `times` runs; 0 where it has none.
   subroutine time_yardstick(shop, i, times, seconds)
      type(workshop_t), intent(inout) :: shop
      integer, intent(in) :: i, times
      real(wp), intent(out) :: seconds
      real(wp) :: started
      integer :: info, k

      seconds = 0.0_wp
      if (i == kernel%residual) then
         shop%spectrum%values = (0.0_wp, 0.0_wp)
         started = wall_clock()
         do k = 1, times
            call shop%plan%to_samples(shop%spectrum%values, shop%samples%values)
            call shop%plan%to_spectrum(shop%samples%values, shop%spectrum%values)
         end do
         seconds = (wall_clock() - started)/times
      else if (allocated(shop%matrix)) then
         do k = 1, times
            shop%matrix = shop%jacobian
            started = wall_clock()
            call dgetrf(size(shop%pivots), size(shop%pivots), shop%matrix, size(shop%pivots), shop%pivots, info)
            seconds = seconds + (wall_clock() - started)/times
         end do
      end if
   end subroutine time_yardstick

   !> Bandwidth of the memory [B/s] by a triad a = b + s c over arrays far larger than the caches; median of several.
   real(wp) function memory_bandwidth()
      integer, parameter :: n = 8*1024*1024, times = 7
      real(wp), allocatable :: a(:), b(:), c(:)
      real(wp) :: bandwidth(times), started
      integer :: k

      allocate (a(n), b(n), c(n), source=1.0_wp)
      do k = 1, times
         started = wall_clock()
         a = b + real(k, wp)*c
         bandwidth(k) = 3*8*real(n, wp)/(wall_clock() - started)
         b(k) = a(k)
      end do
      memory_bandwidth = median(bandwidth)
   end function memory_bandwidth

   !> Median of some numbers; of an even number of them the mean of the middle two.
   pure real(wp) function median(values)
      real(wp), intent(in) :: values(:)                               !! at least one
      real(wp) :: sorted(size(values)), moved
      integer :: i, k

      sorted = values
      do i = 2, size(sorted)
         moved = sorted(i)
         do k = i - 1, 1, -1
            if (sorted(k) <= moved) exit
            sorted(k + 1) = sorted(k)
         end do
         sorted(k + 1) = moved
      end do
      i = size(sorted)
      median = 0.5_wp*(sorted((i + 1)/2) + sorted(i/2 + 1))
   end function median
end module kernel_times
