!> The preconditioner of the balance: the exact tangent between the harmonics that the laws couple most strongly, and
!> the tangent of each other harmonic by itself.
!>
!> Source: docs/why/theory.md, section 6.6.
module hb_preconditioner
   use hb_block_factors, only: block_factors_t, new_block_factors
   use hb_block_pattern, only: block_pattern_t, new_block_pattern
   use hb_coarse_tangent, only: coarse_tangent_t, factor_memory, factor_work, max_memory, new_coarse_tangent
   use hb_dynamic_stiffness, only: chunk_of_columns
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_linear_part, only: linear_part_t
   use hb_projected_laws, only: projected_laws_t, slope
   use hb_threads, only: n_threads
   implicit none
   private
   public :: preconditioner_t, unit_work

   real(wp), parameter :: unit_work = 1.0e6_wp !! multiplications: factors at level 1 take eight times as many

   type :: preconditioner_t
      type(block_pattern_t) :: pattern                                !! of the tangent of one harmonic
      integer, private :: n_harmonics = 0
      logical, private :: needs_reaction = .false.                    ! of any law
      type(block_factors_t), allocatable, private :: alone            ! LU of the tangent of each harmonic
      type(coarse_tangent_t), allocatable, private :: coupled         ! and that between the most strongly coupled ones
   contains
      procedure :: prepare => preconditioner_prepare
      procedure :: harmonic_tangent => preconditioner_harmonic_tangent
      procedure :: update => preconditioner_update
      procedure :: apply => preconditioner_apply
      procedure :: work_of_solution => preconditioner_work_of_solution
   end type preconditioner_t

contains

   !> Determines the pattern of the tangent of one harmonic: the entries of S, pairs coupled by a law, and products of
   !> S with a force that depends on the reaction. The first `update` computes factors; those of a balance that is
   !> created again at another value, as along a curve, are used until the next one.
   subroutine preconditioner_prepare(self, linear, laws)
      class(preconditioner_t), intent(inout) :: self
      type(linear_part_t), intent(in) :: linear
      type(projected_laws_t), intent(in) :: laws
      type(block_pattern_t) :: before
      integer :: law, n_before, half_bandwidth

      before = self%pattern
      n_before = self%n_harmonics
      self%n_harmonics = laws%transform%harmonics%n_harmonics
      self%needs_reaction = laws%needs_reaction
      law = max(0, maxval(abs(laws%jacobian%row - laws%jacobian%column)), laws%memory_bandwidth())
      half_bandwidth = max(linear%pattern%half_bandwidth, law)
      if (laws%needs_reaction) half_bandwidth = linear%pattern%half_bandwidth + law
      call new_block_pattern(self%pattern, linear%n_law, min(linear%n_law, half_bandwidth))
      if (self%n_harmonics == n_before .and. self%pattern%n == before%n .and. self%pattern%half_bandwidth == &
         before%half_bandwidth) return
      if (allocated(self%alone)) deallocate (self%alone)
      if (allocated(self%coupled)) deallocate (self%coupled)
   end subroutine preconditioner_prepare

   !> Computes the tangent of harmonic h by itself, (1 - df/ds) S + df/dq + i w df/dv, from mean slopes in the layout of `pattern`.
   subroutine preconditioner_harmonic_tangent(self, linear, h, frequency, df_dq, df_dv, df_ds, block)
      class(preconditioner_t), intent(in) :: self
      type(linear_part_t), intent(in) :: linear
      integer, intent(in) :: h
      real(wp), intent(in) :: frequency                               !! j.omega [rad/s]
      real(wp), intent(in) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)   !! (pattern%n_rows, n_dofs)
      complex(wp), intent(out) :: block(:, :)                         !! [N/m], (pattern%n_rows, n_dofs)
      complex(wp) :: columns(linear%n_law, chunk_of_columns)
      integer :: i, k, m, start

      associate (own => self%pattern)
         block = (0.0_wp, 0.0_wp)
         do k = 1, own%n
            if (mod(k - 1, chunk_of_columns) == 0) then
               start = k
               call linear%get_columns(start, h, columns(:, :min(chunk_of_columns, own%n - start + 1)))
            end if
            do m = linear%pattern%first(k), linear%pattern%last(k)
               associate (s => columns(m, k - start + 1), at => own%shift(k))
                  block(at + m, k) = block(at + m, k) + s
                  if (.not. self%needs_reaction) cycle
                  do i = max(own%first(m), own%first(k)), min(own%last(m), own%last(k))
                     block(at + i, k) = block(at + i, k) - df_ds(own%shift(m) + i, m)*s
                  end do
               end associate
            end do
            do i = own%first(k), own%last(k)
               associate (row => own%shift(k) + i)
                  block(row, k) = block(row, k) + cmplx(df_dq(row, k), frequency*df_dv(row, k), wp)
               end associate
            end do
            if (linear%is_singular(h)) block(own%shift(k) + k, k) = block(own%shift(k) + k, k) + linear%support_in(k, h)
         end do
      end associate
   end subroutine preconditioner_harmonic_tangent

   !> Updates to the present tangent. Level 0 is the cheapest; each further one takes about eight times the work and
   !> is closer to it.
   subroutine preconditioner_update(self, linear, laws, frequencies, unit, level, is_strongest)
      class(preconditioner_t), intent(inout) :: self
      type(linear_part_t), intent(in) :: linear
      type(projected_laws_t), intent(inout) :: laws                   !! differentiated
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(in) :: unit(:)                                 !! stiffness of a harmonic that is singular by itself [N/m],
                                                                      !! (n_dofs)
      integer, intent(in) :: level                                    !! >= 0
      logical, intent(out) :: is_strongest                            !! a higher level would not be better
      real(wp), dimension(self%pattern%n_rows, laws%n_dofs) :: df_dq, df_dv, df_ds
      real(wp), dimension(laws%n_dofs) :: varies_q, varies_v, varies_s
      real(wp) :: coupling(size(frequencies))
      integer :: h, n

      call laws%mean_slopes(self%pattern, df_dq, df_dv, df_ds)
      df_dq = laws%factor*df_dq
      df_dv = laws%factor*df_dv
      df_ds = laws%factor*df_ds
      call laws%jacobian%variation(varies_q, varies_v, varies_s)
      if (.not. allocated(self%alone)) then
         allocate (self%alone)
         call new_block_factors(self%alone, self%pattern, size(frequencies), are_corrected=.true.)
      end if
      n = n_threads(size(frequencies)*self%pattern%n_rows*laws%n_dofs)
      !$omp parallel do num_threads(n) schedule(dynamic) if (n > 1)
      do h = 1, size(frequencies)
         call update_harmonic(h)
      end do
      call choose_coupled(self, laws%transform%harmonics, level, coupling, is_strongest)
      if (allocated(self%coupled)) call fill_coupled(self, linear, laws, frequencies)

   contains

      subroutine update_harmonic(h)
         integer, intent(in) :: h
         complex(wp) :: block(self%pattern%n_rows, laws%n_dofs)
         logical :: is_singular
         integer :: i

         call self%harmonic_tangent(linear, h, frequencies(h), df_dq, df_dv, df_ds, block)
         coupling(h) = coupling_of(h, block)
         call self%alone%factorise(h, block, is_singular)
         if (is_singular) then                                        ! a unit step per unit force: the value is arbitrary
            block = (0.0_wp, 0.0_wp)
            do i = 1, laws%n_dofs
               block(self%pattern%shift(i) + i, i) = cmplx(unit(i), kind=wp)
            end do
            call self%alone%factorise(h, block, is_singular)
         end if
      end subroutine update_harmonic

      !> Strength of the response of a harmonic to others through the laws: the variation of their slopes, relative to
      !> its own stiffness, at the degree of freedom with the largest ratio.
      real(wp) function coupling_of(h, block)
         integer, intent(in) :: h
         complex(wp), intent(in) :: block(:, :)
         integer :: i

         coupling_of = 0.0_wp
         do i = 1, laws%n_dofs
            associate (own => abs(block(self%pattern%shift(i) + i, i)), stiffness => abs(linear%entry(i, i, h)))
               coupling_of = max(coupling_of, (varies_q(i) + abs(frequencies(h))*varies_v(i) + stiffness*varies_s(i))/ &
                                 max(tiny(1.0_wp), own))
            end associate
         end do
      end function coupling_of
   end subroutine preconditioner_update

   !> Selects the harmonics with the strongest coupling, as many as the level permits; with all of them the factors
   !> are those of the tangent itself, but for laws with memory, whose coupling is not known.
   subroutine choose_coupled(self, set, level, coupling, is_strongest)
      type(preconditioner_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: level
      real(wp), intent(in) :: coupling(:)                             !! (n_harmonics)
      logical, intent(out) :: is_strongest
      integer, allocatable :: retained(:)
      integer :: most, possible

      possible = count(coupling > 0.0_wp)                             ! others are solved exactly alone, as far as is known
      is_strongest = possible == 0
      if (level == 0 .or. is_strongest) then
         if (allocated(self%coupled)) deallocate (self%coupled)
         return
      end if
      do while (factor_memory(2*possible, self%pattern%n, self%pattern%half_bandwidth) > max_memory .and. possible > 0)
         possible = possible - max(1, possible/32)
      end do
      most = possible
      do while (factor_work(2*most, self%pattern%n, self%pattern%half_bandwidth) > unit_work*8.0_wp**level .and. most > 0)
         most = most - max(1, most/32)
      end do
      is_strongest = most == possible
      retained = strongest(coupling, most)
      if (allocated(self%coupled)) then
         if (size(self%coupled%retained) == size(retained)) then
            if (all(self%coupled%retained == retained)) return
         end if
         deallocate (self%coupled)
      end if
      if (size(retained) == 0) return
      allocate (self%coupled)
      call new_coarse_tangent(self%coupled, set, retained, self%pattern%n, self%pattern%half_bandwidth)
   end subroutine choose_coupled

   !> Indices of the largest values, at most `most` of them, in ascending order; of equal ones all or none.
   pure function strongest(values, most) result(retained)
      real(wp), intent(in) :: values(:)                               !! >= 0
      integer, intent(in) :: most
      integer, allocatable :: retained(:)
      real(wp) :: lowest, highest, middle
      integer :: h, step

      if (size(values) <= most) then
         retained = [(h, h=1, size(values))]
         return
      end if
      lowest = -1.0_wp
      highest = maxval(values)
      do step = 1, 100                                                ! bisection to rounding
         middle = 0.5_wp*(lowest + highest)
         if (count(values > middle) > most) then
            lowest = middle
         else
            highest = middle
         end if
      end do
      retained = pack([(h, h=1, size(values))], values > highest)
   end function strongest

   !> The tangent between the selected harmonics, term by term as in hb_dense_tangent, and its factors. The correction
   !> of kinks is omitted: it costs more than the products that it saves. Laws with memory enter by their mean slopes.
   subroutine fill_coupled(self, linear, laws, frequencies)
      type(preconditioner_t), intent(inout) :: self
      type(linear_part_t), intent(in) :: linear
      type(projected_laws_t), intent(inout) :: laws
      real(wp), intent(in) :: frequencies(:)
      type(error_t), allocatable :: error
      integer :: i

      call laws%prepare_products(error)
      if (allocated(error)) then                                      ! out of memory: each harmonic by itself must suffice
         deallocate (self%coupled)
         return
      end if
      call self%coupled%clear()
      call add_linear_part(self%coupled, linear)
      call add_memory(self%coupled, self%pattern, laws)
      do i = 1, laws%jacobian%n_pairs
         call laws%tabulate(i, 1)
         call add_pair(self%coupled, laws, laws%jacobian%row(i), laws%jacobian%column(i), frequencies)
         if (laws%needs_reaction) &
            call add_reaction(self%coupled, linear, laws, laws%jacobian%row(i), laws%jacobian%column(i))
      end do
      call self%coupled%factorise()
   end subroutine fill_coupled

   !> Adds the condensed linear part and the supports, which couple each harmonic with itself.
   subroutine add_linear_part(coupled, linear)
      type(coarse_tangent_t), intent(inout) :: coupled
      type(linear_part_t), intent(in) :: linear
      complex(wp) :: stiffness(coupled%set%n_harmonics)
      integer :: h, i, k

      do k = 1, linear%n_law
         do i = linear%pattern%first(k), linear%pattern%last(k)
            do h = 1, coupled%set%n_harmonics
               stiffness(h) = linear%entry(i, k, coupled%retained(h))
               if (i == k) stiffness(h) = stiffness(h) + linear%support_in(i, coupled%retained(h))
            end do
            call coupled%add_alone(i, k, stiffness)
         end do
      end do
   end subroutine add_linear_part

   !> Adds the mean slopes of laws with memory.
   subroutine add_memory(coupled, pattern, laws)
      type(coarse_tangent_t), intent(inout) :: coupled
      type(block_pattern_t), intent(in) :: pattern                    !! of a harmonic
      type(projected_laws_t), intent(inout) :: laws
      complex(wp) :: stiffness(coupled%set%n_harmonics)
      real(wp) :: slopes(pattern%n_rows, laws%n_dofs)
      integer :: i, k

      slopes = 0.0_wp
      call laws%add_memory_slopes(pattern, slopes)
      do k = 1, laws%n_dofs
         do i = pattern%first(k), pattern%last(k)
            stiffness = cmplx(laws%factor*slopes(pattern%shift(k) + i, k), kind=wp)
            call coupled%add_alone(i, k, stiffness)
         end do
      end do
   end subroutine add_memory

   !> Adds the derivatives of a force by a motion and by its rate, of the pair that is tabulated.
   subroutine add_pair(coupled, laws, row, column, frequencies)
      type(coarse_tangent_t), intent(inout) :: coupled
      type(projected_laws_t), intent(in) :: laws
      integer, intent(in) :: row                                      !! of the force
      integer, intent(in) :: column                                   !! of the motion
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], of all harmonics
      real(wp), dimension(coupled%set%n_coefficients) :: cosine, cosine_of_rate, sine, sine_of_rate
      integer :: h

      associate (set => coupled%set)
         do h = 1, set%n_harmonics
            call find_columns(coupled, laws, h, slope%by_motion, cosine, sine)
            if (laws%needs_velocity .and. set%sin_at(h) > 0) then
               call find_columns(coupled, laws, h, slope%by_rate, cosine_of_rate, sine_of_rate)
               associate (w => frequencies(coupled%retained(h)))
                  cosine = cosine - w*sine_of_rate
                  sine = sine + w*cosine_of_rate
               end associate
            end if
            call coupled%add_column(row, column, set%cos_at(h), cosine)
            if (set%sin_at(h) > 0) call coupled%add_column(row, column, set%sin_at(h), sine)
         end do
      end associate
   end subroutine add_pair

   !> Adds the derivatives of a force by the reaction, of the pair that is tabulated: the reaction to a motion is -S times it.
   subroutine add_reaction(coupled, linear, laws, row, column)
      type(coarse_tangent_t), intent(inout) :: coupled
      type(linear_part_t), intent(in) :: linear
      type(projected_laws_t), intent(in) :: laws
      integer, intent(in) :: row                                      !! of the force
      integer, intent(in) :: column                                   !! of the reaction
      real(wp), dimension(coupled%set%n_coefficients) :: cosine, sine
      integer :: h, k

      associate (set => coupled%set)
         do h = 1, set%n_harmonics
            call find_columns(coupled, laws, h, slope%by_reaction, cosine, sine)
            do k = linear%pattern%first(column), linear%pattern%last(column)
               associate (s => linear%entry(column, k, coupled%retained(h)))
                  call coupled%add_column(row, k, set%cos_at(h), aimag(s)*sine - real(s)*cosine)
                  if (set%sin_at(h) > 0) call coupled%add_column(row, k, set%sin_at(h), -aimag(s)*cosine - real(s)*sine)
               end associate
            end do
         end do
      end associate
   end subroutine add_reaction

   !> The columns of a slope of the pair that is tabulated, for one of the selected harmonics.
   subroutine find_columns(coupled, laws, h, part, cosine, sine)
      type(coarse_tangent_t), intent(in) :: coupled
      type(projected_laws_t), intent(in) :: laws
      integer, intent(in) :: h                                        !! among the selected ones
      integer, intent(in) :: part                                     !! one of `slope`
      real(wp), intent(out), contiguous :: cosine(:), sine(:)         !! (set%n_coefficients)

      associate (retained => coupled%retained, table => laws%table)
         call table%columns_among(part, coupled%set, table%offset(retained), table%offset(retained(h)), cosine, sine)
      end associate
   end subroutine find_columns

   !> Solves for each harmonic by itself, then for those that are coupled.
   subroutine preconditioner_apply(self, set, r, step)
      class(preconditioner_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: r(set%n_coefficients, self%pattern%n)   !! [N]
      real(wp), intent(out) :: step(set%n_coefficients, self%pattern%n)   !! [m]

      call self%alone%solve_harmonics(set, r, step)
      if (.not. allocated(self%coupled)) return
      if (self%coupled%is_usable) call self%coupled%solve(r, step)
   end subroutine preconditioner_apply

   !> Work of `apply`, see hb_solver_types%unit_of_work: the factors are read from memory once.
   pure real(wp) function preconditioner_work_of_solution(self) result(work)
      class(preconditioner_t), intent(in) :: self

      work = 0.0_wp
      if (allocated(self%coupled)) work = self%coupled%n_factors()
   end function preconditioner_work_of_solution
end module hb_preconditioner
