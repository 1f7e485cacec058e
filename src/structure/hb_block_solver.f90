!> Linear equations with a square block of the dynamic stiffness, at one frequency after the other.
!>
!> A structure need not be supported. At zero frequency `hold_free` then finds rows that represent its free motions and adds a
!> spring to each: if forces are in equilibrium the springs remain unstressed, and the solution is that with zero motion at these
!> rows.
!>
!> Blocks that are diagonal except for a border are factorised as such (hb_arrow_factors), narrow ones as band
!> matrices (hb_band_factors), if necessary in another order of the unknowns, large ones
!> with few entries as sparse matrices (UMFPACK), others as dense ones (LAPACK, or hb_small_lu); all but the first with
!> row exchanges. Solutions of the last two at many frequencies are taken from one space (hb_solution_space), where that
!> has them; factors follow where it does not. Rows and columns are scaled once, by the magnitudes on the diagonal and those
!> beside it (hb_balancing), so that the verdict "singular" depends neither on units of coordinates nor on those of equations.
module hb_block_solver
   use hb_arrow_factors, only: arrow_factors_t, new_arrow_factors
   use hb_balancing, only: balancing_factors
   use hb_band_factors, only: factorise_band, solve_band
   use hb_kinds, only: wp
   use hb_lapack, only: zgetrf, zgetrs
   use hb_narrow_band, only: narrow_order
   use hb_small_lu, only: factorise_small, largest_small, solve_small
   use hb_solution_space, only: pays_to_span, solution_space_t
   use hb_structure_block, only: structure_block_t
   use hb_umfpack, only: umfpack_t
   implicit none
   private
   public :: block_solver_t, new_block_solver, probe_vector, suspicious_growth

   !> Growth of the probe vector, relative to the matrix, above which the condition number is estimated.
   real(wp), parameter :: suspicious_growth = 1.0e8_wp

   integer, parameter :: min_sparse = 400                           ! smallest order of a sparse block
   real(wp), parameter :: max_band_fill = 10.0_wp                     ! elements of the band or matrix per entry

   type :: block_solver_t
      integer :: n = 0                                       !! order of the block
      logical :: is_banded = .false., is_sparse = .false.
      logical, private :: is_arrow = .false.                 !! at the present frequency
      type(arrow_factors_t), private :: arrow
      complex(wp), allocatable :: rhs(:, :)                  !! (n, n_rhs + 1), right-hand sides, solutions
      integer, private :: n_lower = 0, n_upper = 0, n_rhs = 0
      integer, allocatable, private :: order(:)              !! of the unknowns in the factors, if it is another one
      type(structure_block_t), private :: entries            !! scaled
      real(wp), allocatable, private :: of_row(:), of_column(:) !! (n), factors of the rows and columns of the block
      complex(wp), allocatable, private :: probe(:)          !! (n), in no particular direction
      complex(wp), allocatable, private :: matrix(:, :)      !! dense (n, n), or LAPACK band storage
      complex(wp), allocatable, private :: s(:)              !! values of the entries
      real(wp), allocatable, private :: magnitude(:), row_sum(:)
      integer, allocatable, private :: pivots(:)
      integer, allocatable, private :: by_column(:)          !! entries column by column, of a sparse block
      integer, allocatable, private :: first(:)              !! (n + 1), of each column among these
      type(umfpack_t), private :: factors                    !! of a sparse block, until `end`
      logical, private :: is_analysed = .false.              !! the pattern of a sparse block
      type(solution_space_t), private :: space
      logical, private :: is_in_space = .false.              !! the last solution, there are no factors
      real(wp), private :: highest_frequency = 0.0_wp        !! [rad/s], for which the block is scaled
      real(wp), private :: frequency = 0.0_wp, drive = 0.0_wp !! of the last `solve`
      integer, allocatable :: held(:)                        !! rows with springs at zero frequency; not allocated: none
      real(wp), allocatable :: unsupported(:)                !! (n_rhs), of the last solution with springs: their largest force,
                                                             !! relative to the right-hand side
      integer, allocatable, private :: springs(:)            !! entries on the diagonal, of `held`
      real(wp), private :: spring = 0.0_wp                   !! stiffness of each, scaled
      logical, private :: is_held = .false.                  !! also at other frequencies
   contains
      procedure :: begin => block_solver_begin
      procedure :: end => block_solver_end
      procedure :: hold_free => block_solver_hold_free
      procedure :: learn => block_solver_learn
      procedure :: prefers_space => block_solver_prefers_space
      procedure :: set_tuple => block_solver_set_tuple
      procedure :: solve => block_solver_solve
      procedure :: solve_again => block_solver_solve_again
      procedure, private :: assemble => block_solver_assemble
   end type block_solver_t

contains

   !> Creates a solver for `n_rhs` right-hand sides; `highest_frequency` only determines the scaling.
   subroutine new_block_solver(self, block, n, n_rhs, highest_frequency)
      type(block_solver_t), intent(out) :: self
      type(structure_block_t), intent(in) :: block                    !! square
      integer, intent(in) :: n, n_rhs
      real(wp), intent(in) :: highest_frequency                       !! [rad/s]
      real(wp) :: d(n), scale(n)
      integer :: e, n_rows

      self%n = n
      self%n_rhs = n_rhs
      self%highest_frequency = highest_frequency
      allocate (self%rhs(n, n_rhs + 1))
      if (n == 0) return
      self%entries = block
      allocate (self%s(block%n_entries), self%magnitude(block%n_entries))
      scale = 1.0_wp
      call block%magnitude(highest_frequency, self%magnitude)
      do e = 1, block%n_entries
         if (block%row(e) /= block%column(e) .or. .not. self%magnitude(e) > 0.0_wp) cycle
         scale(block%row(e)) = 1.0_wp/sqrt(self%magnitude(e))
      end do
      d = balancing_factors(n, block%row, block%column, scale(block%row)*self%magnitude*scale(block%column))
      self%of_row = scale/d
      self%of_column = scale*d
      call self%entries%scale_by(self%of_row, self%of_column)

      n_rows = find_band(self)
      call new_arrow_factors(self%arrow, n, block%row, block%column)
      self%is_sparse = n >= min_sparse .and. real(min(n_rows, n), wp)*n > max_band_fill*block%n_entries
      if (self%arrow%is_arrow) self%is_sparse = .false.
      if (2*n_rows > n .and. block%n_entries < n*(n/8) .and. .not. (self%is_sparse .or. self%arrow%is_arrow)) &
         n_rows = sort_by_position(self)
      self%is_banded = 2*n_rows <= n .and. .not. (self%is_sparse .or. self%arrow%is_arrow)
      if (.not. self%is_banded) n_rows = max(1, n)
      if (self%is_sparse) then
         n_rows = 0
         call sort_by_column(self)
      end if
      self%probe = probe_vector(n)
      allocate (self%matrix(n_rows, n), self%pivots(n), self%row_sum(n))
   end subroutine new_block_solver

   !> Finds the outermost diagonals with entries and returns the number of rows of the band, for LAPACK with room for row
   !> exchanges.
   integer function find_band(self) result(n_rows)
      class(block_solver_t), intent(inout) :: self

      associate (row => self%entries%row, column => self%entries%column)
         self%n_lower = max(0, maxval(row - column))
         self%n_upper = max(0, maxval(column - row))
      end associate
      n_rows = 2*self%n_lower + self%n_upper + 1
   end function find_band

   !> Reorders the unknowns if that gives a narrow band, and returns the number of rows of the band.
   integer function sort_by_position(self) result(n_rows)
      class(block_solver_t), intent(inout) :: self
      integer :: i, position(self%n)
      type(structure_block_t) :: before

      before = self%entries
      position = narrow_order(self%n, before%row, before%column)
      self%entries%row = position(before%row)
      self%entries%column = position(before%column)
      n_rows = find_band(self)
      if (2*n_rows <= self%n) then
         allocate (self%order(self%n))
         self%order(position) = [(i, i=1, self%n)]
      else
         self%entries = before
         n_rows = find_band(self)
      end if
   end function sort_by_position

   !> Sorts the entries by columns, and by rows within a column.
   subroutine sort_by_column(self)
      type(block_solver_t), intent(inout) :: self
      integer, allocatable :: by_row(:), next(:)
      integer :: e, i

      associate (n_entries => self%entries%n_entries, row => self%entries%row, column => self%entries%column)
         allocate (by_row(n_entries), self%by_column(n_entries))
         next = starts(row, self%n)
         do e = 1, n_entries
            by_row(next(row(e))) = e
            next(row(e)) = next(row(e)) + 1
         end do
         self%first = starts(column, self%n)
         next = self%first
         do i = 1, n_entries
            e = by_row(i)
            self%by_column(next(column(e))) = e
            next(column(e)) = next(column(e)) + 1
         end do
      end associate
   end subroutine sort_by_column

   !> Start of each of n classes when members are sorted by class; n + 1 is the end.
   pure function starts(class_of, n)
      integer, intent(in) :: class_of(:), n
      integer, allocatable :: starts(:)
      integer :: e, i

      allocate (starts(n + 1), source=0)
      do e = 1, size(class_of)
         starts(class_of(e) + 1) = starts(class_of(e) + 1) + 1
      end do
      starts(1) = 1
      do i = 1, n
         starts(i + 1) = starts(i) + starts(i + 1)
      end do
   end function starts

   !> Must be called before the first `solve` of some frequencies; `end` frees memory that this and what follows takes. Of
   !> many frequencies the solutions may come from a space, which depends on nothing before.
   subroutine block_solver_begin(self, n_frequencies)
      class(block_solver_t), intent(inout) :: self
      integer, intent(in) :: n_frequencies

      self%is_in_space = .false.
      if (self%arrow%is_arrow .or. self%is_banded) return
      if (.not. pays_to_span(self%n, self%n_rhs, n_frequencies)) return
      if (self%is_sparse) then
         call self%space%begin(self%n, self%entries, self%highest_frequency, self%first, self%by_column)
      else
         call self%space%begin(self%n, self%entries, self%highest_frequency)
      end if
   end subroutine block_solver_begin

   !> Whether solutions come from a space, which is the smaller the higher the first frequency is.
   pure logical function block_solver_prefers_space(self) result(prefers)
      class(block_solver_t), intent(in) :: self

      prefers = self%space%is_on
   end function block_solver_prefers_space

   !> Prepares the space for some of the systems to be solved.
   subroutine block_solver_learn(self, frequencies, drives, rhs)
      class(block_solver_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:), drives(:)      !! as those of `solve`, (n_systems)
      complex(wp), intent(in) :: rhs(:, :, :)                !! (n, n_rhs, n_systems)
      complex(wp) :: scaled(size(rhs, 1), size(rhs, 2), size(rhs, 3))
      integer :: i, k

      do k = 1, size(rhs, 3)
         do i = 1, size(rhs, 2)
            scaled(:, i, k) = self%of_row*rhs(:, i, k)
         end do
      end do
      call self%space%learn(frequencies, drives, scaled)
   end subroutine block_solver_learn

   !> A vector in no particular direction.
   pure function probe_vector(n) result(probe)
      integer, intent(in) :: n
      complex(wp) :: probe(n)
      integer :: i

      probe = [(cmplx(cos(real(i, wp)), kind=wp), i=1, n)]
   end function probe_vector

   !> Frees the memory of a sparse block and of the space.
   subroutine block_solver_end(self)
      class(block_solver_t), intent(inout) :: self

      if (self%is_sparse) call self%factors%destroy()
      self%is_analysed = .false.
      call self%space%end()
   end subroutine block_solver_end

   !> Sets the tuple of the harmonic that is solved next.
   pure subroutine block_solver_set_tuple(self, tuple)
      class(block_solver_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)                        !! (n_tones)

      call self%entries%set_tuple(tuple)
   end subroutine block_solver_set_tuple

   !> Solves S(frequency, drive) X = rhs(:, 1:n_rhs) in place, and returns a measure of the distance of S from a
   !> singular matrix.
   !>
   !> The last column of `rhs` is a probe, a vector in no particular direction. If it grows strongly, one step of
   !> power iteration with the inverse of S**H S follows, which converges at once near a singularity. (LAPACK's
   !> estimator takes longer than factors and solution together, and misses the resonances of long chains by a factor
   !> of at least 100.)
   subroutine block_solver_solve(self, frequency, drive, reciprocal_condition)
      class(block_solver_t), intent(inout) :: self
      real(wp), intent(in) :: frequency                      !! [rad/s]
      real(wp), intent(in) :: drive                          !! [rad**2/s**2]
      real(wp), intent(out) :: reciprocal_condition          !! from 0, singular (rhs is undefined then), to 1
      real(wp) :: growth, norm
      integer :: i
      logical :: is_singular

      reciprocal_condition = 1.0_wp
      if (self%n == 0) return
      self%frequency = frequency
      self%drive = drive
      self%is_in_space = .false.
      if (self%space%is_on .and. .not. has_springs(self, frequency)) call solve_in_space(self)
      if (self%is_in_space) return
      call factorise(self, norm, is_singular)
      reciprocal_condition = 0.0_wp
      if (is_singular) return

      do i = 1, self%n_rhs
         self%rhs(:, i) = self%of_row*self%rhs(:, i)
      end do
      if (has_springs(self, frequency)) self%unsupported = norm2(abs(self%rhs(:, :self%n_rhs)), dim=1)
      associate (probe => self%rhs(:, self%n_rhs + 1:))
         probe(:, 1) = self%probe
         growth = 1.0_wp/length_of(probe)
         call back_substitute(self, "N", self%rhs)
         growth = growth*length_of(probe)
         if (norm*growth > suspicious_growth) then
            probe = probe/cmplx(length_of(probe), kind=wp)
            call back_substitute(self, "C", probe)
            probe = probe/cmplx(length_of(probe), kind=wp)
            call back_substitute(self, "N", probe)
            growth = length_of(probe)
         end if
      end associate
      reciprocal_condition = 1.0_wp/max(1.0_wp, norm*growth)
      if (has_springs(self, frequency)) then
         do i = 1, self%n_rhs
            self%unsupported(i) = self%spring*maxval([0.0_wp, abs(self%rhs(self%held, i))])/ &
                                  max(self%unsupported(i), tiny(1.0_wp))
         end do
      end if
      do i = 1, self%n_rhs
         self%rhs(:, i) = self%of_column*self%rhs(:, i)
      end do
   end subroutine block_solver_solve

   !> Solves at the present frequency in the space, if it has the solutions and these are no sign of a nearly singular matrix:
   !> then `is_in_space`, otherwise the right-hand sides are unchanged.
   subroutine solve_in_space(self)
      class(block_solver_t), intent(inout) :: self
      complex(wp) :: b(self%n, self%n_rhs)
      real(wp) :: forces(self%n_rhs), motions(self%n_rhs)
      integer :: i

      do i = 1, self%n_rhs
         b(:, i) = self%of_row*self%rhs(:, i)
      end do
      forces = norm2(abs(b), dim=1)
      call self%space%solve(self%frequency, self%drive, b, self%is_in_space)
      if (.not. self%is_in_space) return
      motions = norm2(abs(b), dim=1)
      self%is_in_space = all(self%space%size_of_terms(self%frequency, self%drive)*motions <= suspicious_growth*forces)
      if (.not. self%is_in_space) return
      do i = 1, self%n_rhs
         self%rhs(:, i) = self%of_column*b(:, i)
      end do
   end subroutine solve_in_space

   !> Factorises S at the present frequency; `norm` is the largest row sum of its terms before cancellation.
   subroutine factorise(self, norm, is_singular)
      class(block_solver_t), intent(inout) :: self
      real(wp), intent(out) :: norm
      logical, intent(out) :: is_singular
      integer :: info

      call self%assemble(self%frequency, self%drive, norm)
      if (self%is_arrow) then
         is_singular = .false.
      else if (self%is_sparse) then
         if (.not. self%is_analysed) self%is_analysed = self%factors%analyse(self%first, self%entries%row(self%by_column))
         is_singular = .not. self%is_analysed
         if (self%is_analysed) is_singular = .not. self%factors%factorise(self%s(self%by_column))
      else if (self%is_banded) then
         call factorise_band(self%matrix, self%n_lower, self%n_upper, self%pivots, is_singular)
      else if (self%n <= largest_small) then
         call factorise_small(self%matrix, self%pivots, is_singular)
      else
         call zgetrf(self%n, self%n, self%matrix, self%n, self%pivots, info)
         is_singular = info > 0
      end if
   end subroutine factorise

   !> Holds the free motions of a block that is singular at zero frequency by springs, which act there from now on.
   !> Each row is that with the largest amplitude of a motion that the rows before leave free: the response to a force in no
   !> particular direction at a very low frequency.
   subroutine block_solver_hold_free(self, highest_frequency, lowest_condition, is_done)
      class(block_solver_t), intent(inout) :: self
      real(wp), intent(in) :: highest_frequency              !! [rad/s], of the scaling
      real(wp), intent(in) :: lowest_condition               !! reciprocal, of a block that is not singular
      logical, intent(out) :: is_done                        !! the block is no longer singular
      real(wp), parameter :: low_ratio = 1.0e-6_wp           ! relative to the highest frequency
      real(wp) :: reciprocal_condition
      integer :: e, p, row

      allocate (self%held(0), self%springs(0))
      self%spring = maxval(self%row_sum)                     ! at zero frequency
      if (.not. self%spring > 0.0_wp) self%spring = 1.0_wp
      do
         self%rhs(:, :self%n_rhs) = (0.0_wp, 0.0_wp)
         self%is_held = .true.
         call self%solve(low_ratio*merge(highest_frequency, 1.0_wp, highest_frequency > 0.0_wp), 0.0_wp, reciprocal_condition)
         self%is_held = .false.
         if (.not. reciprocal_condition > 0.0_wp) exit
         p = maxloc(abs(self%rhs(:, self%n_rhs + 1)), dim=1)
         row = p
         if (allocated(self%order)) row = findloc(self%order, p, dim=1)
         e = findloc(self%entries%row == row .and. self%entries%column == row, .true., dim=1)
         if (e == 0 .or. any(self%held == p)) exit
         self%held = [self%held, p]
         self%springs = [self%springs, e]
         call self%solve(0.0_wp, 0.0_wp, reciprocal_condition)
         is_done = .not. reciprocal_condition < lowest_condition
         if (is_done) return
      end do
      is_done = .false.
      deallocate (self%held, self%springs)
   end subroutine block_solver_hold_free

   !> Whether springs hold the block at a frequency.
   pure logical function has_springs(self, frequency)
      class(block_solver_t), intent(in) :: self
      real(wp), intent(in) :: frequency                      !! [rad/s]

      has_springs = allocated(self%held) .and. (self%is_held .or. .not. abs(frequency) > 0.0_wp)
   end function has_springs

   !> Solves S X = rhs(:, 1:n_rhs) in place at the frequency of the last `solve`, with its factors or in the space.
   subroutine block_solver_solve_again(self)
      class(block_solver_t), intent(inout) :: self
      real(wp) :: norm
      logical :: is_singular
      integer :: i

      if (self%n == 0) return
      if (self%is_in_space) then
         call solve_in_space(self)
         if (self%is_in_space) return
         call factorise(self, norm, is_singular)
      end if
      do i = 1, self%n_rhs
         self%rhs(:, i) = self%of_row*self%rhs(:, i)
      end do
      call back_substitute(self, "N", self%rhs(:, :self%n_rhs))
      do i = 1, self%n_rhs
         self%rhs(:, i) = self%of_column*self%rhs(:, i)
      end do
   end subroutine block_solver_solve_again

   !> Solves S X = b (`form` "N") or S**H X = b (`form` "C") in place with the factors of S.
   subroutine back_substitute(self, form, b)
      class(block_solver_t), intent(in) :: self
      character, intent(in) :: form
      complex(wp), contiguous, intent(inout) :: b(:, :)      !! (n, any)

      if (allocated(self%order)) b = b(self%order, :)
      call substitute(self, form, b)
      if (allocated(self%order)) b(self%order, :) = b
   end subroutine back_substitute

   !> The same in the order of the factors.
   subroutine substitute(self, form, b)
      class(block_solver_t), intent(in) :: self
      character, intent(in) :: form
      complex(wp), contiguous, intent(inout) :: b(:, :)      !! (n, any)
      integer :: i, info

      if (self%is_arrow) then
         call self%arrow%solve(form, b)
      else if (self%is_sparse) then
         do i = 1, size(b, 2)
            call self%factors%solve(b(:, i), form == "C")
         end do
      else if (self%is_banded) then
         call solve_band(form, self%matrix, self%n_lower, self%n_upper, self%pivots, b)
      else if (self%n <= largest_small .and. form == "N") then
         call solve_small(self%matrix, self%pivots, b)
      else
         call zgetrs(form, self%n, size(b, 2), self%matrix, self%n, self%pivots, b, self%n, info)
      end if
   end subroutine substitute

   !> Euclidean length of a single column.
   pure real(wp) function length_of(column)
      complex(wp), intent(in) :: column(:, :)                !! (n, 1)

      length_of = sqrt(sum(real(column)**2 + aimag(column)**2))
   end function length_of

   !> Fills the matrix, or factorises it if it is diagonal except for a border; `norm` is the largest row sum of the
   !> terms of S before cancellation.
   subroutine block_solver_assemble(self, frequency, drive, norm)
      class(block_solver_t), intent(inout) :: self
      real(wp), intent(in) :: frequency, drive
      real(wp), intent(out) :: norm
      integer :: e, shift

      call self%entries%evaluate(frequency, drive, self%s)
      call self%entries%magnitude(frequency, self%magnitude)
      if (has_springs(self, frequency)) then
         self%s(self%springs) = self%s(self%springs) + self%spring
         self%magnitude(self%springs) = self%magnitude(self%springs) + self%spring
      end if
      self%row_sum = 0.0_wp
      if (self%arrow%is_arrow) then
         self%is_arrow = self%arrow%factorise(self%entries%row, self%entries%column, self%s)
      end if
      if (.not. self%is_arrow) self%matrix = (0.0_wp, 0.0_wp)
      shift = self%n_lower + self%n_upper + 1
      associate (row => self%entries%row, column => self%entries%column)
         if (self%is_banded) then
            do e = 1, self%entries%n_entries
               self%matrix(shift + row(e) - column(e), column(e)) = self%s(e)
            end do
         else if (.not. (self%is_sparse .or. self%is_arrow)) then
            do e = 1, self%entries%n_entries
               self%matrix(row(e), column(e)) = self%s(e)
            end do
         end if
         do e = 1, self%entries%n_entries
            self%row_sum(row(e)) = self%row_sum(row(e)) + self%magnitude(e)
         end do
      end associate
      norm = maxval(self%row_sum)
   end subroutine block_solver_assemble
end module hb_block_solver
