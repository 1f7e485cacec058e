!> Block elimination of the interior from the dynamic stiffness of one harmonic, and its derivatives.
!>
!> Symbols and equations: hb_dynamic_stiffness. A condensation contains the data that do not depend on the frequency,
!> and the results of the last harmonic.
module hb_condensation
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_block_pattern, only: block_pattern_t, new_block_pattern
   use hb_block_solver, only: block_solver_t, new_block_solver
   use hb_coordinates, only: coordinates_t
   use hb_kinds, only: wp
   use hb_lapack, only: zgemm
   use hb_shared_stiffness, only: new_shared_stiffness, pays_to_share, shared_stiffness_t
   use hb_structure, only: structure_t
   use hb_structure_block, only: new_structure_block, structure_block_t
   implicit none
   private
   public :: condensation_t, condensed_half_bandwidth, new_condensation

   !> Below this reciprocal condition number, or n_interior*epsilon if larger, the interior counts as singular:
   !> rounding of a singular matrix has this size.
   real(wp), parameter :: lowest_condition = 1.0e-14_wp
   real(wp), parameter :: free_force = 1.0e-8_wp             ! force of a spring that holds a free motion, relative to all

   type :: slope_by_t
      integer :: frequency = 1, drive = 2, value = 3         !! the value changes the structure
   end type slope_by_t
   type(slope_by_t), parameter :: slope_by = slope_by_t()

   !> Entries of a structure between coordinates and interior.
   type :: blocks_t
      type(structure_block_t) :: ll, lr, rl, rr
   end type blocks_t

   type, extends(blocks_t) :: condensation_t
      integer, allocatable :: positions(:), interior(:)      !! degrees of freedom of coordinates and of the interior
      type(block_pattern_t) :: pattern                       !! of S_c
      type(amplitudes_t) :: loads                            !! [N]
      type(amplitudes_t) :: load_slopes                      !! dP/dw [N s]
      type(blocks_t), allocatable :: change !! derivative of the structure with respect to a value, if slopes are with respect to it
      real(wp), allocatable :: rates(:)                      !! derivatives of the frequencies with respect to that value; not
                                                             !! allocated: 1, slopes are with respect to the frequency
      real(wp), allocatable :: drive_rates(:)                !! likewise of the drives; not allocated: 0
      integer, allocatable :: tuples(:, :)                   !! (n_tones, n_harmonics), where the structure depends on them
      type(block_solver_t) :: solver                         !! of rr
      complex(wp), allocatable :: held_motion(:)             !! y of the last harmonic
      complex(wp), allocatable :: transfer(:, :)             !! T of the last harmonic
      integer :: drifting = 0                                !! degree of freedom with a static load that nothing supports; 0: none
      ! entries of the last harmonic, the full S_lr if matrix products are faster, memory for slopes of loads
      complex(wp), allocatable, private :: s_ll(:), s_rl(:), s_lr(:), full_lr(:, :), load_slope(:)
      real(wp), private :: drive = 0.0_wp                             ! likewise
      real(wp), private :: highest_frequency = 0.0_wp                 ! [rad/s]
   contains
      procedure :: begin => condensation_begin
      procedure :: end => condensation_end
      procedure :: eliminate => condensation_eliminate
      procedure :: get_block => condensation_get_block
      procedure :: can_share => condensation_can_share
      procedure :: begin_shared => condensation_begin_shared
      procedure :: add_to_shared => condensation_add_to_shared
      procedure :: find_slopes => condensation_find_slopes
      procedure :: free_dofs => condensation_free_dofs
   end type condensation_t

contains

   !> Creates the condensation of `structure` to coordinates; loads may be slopes.
   subroutine new_condensation(self, structure, coordinates, loads, highest_frequency, load_slopes, change)
      type(condensation_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      real(wp), intent(in) :: highest_frequency                       !! [rad/s], only determines the scaling
      type(amplitudes_t), intent(in) :: load_slopes                   !! dP/dw [N s]; with zero degrees of freedom: zero
      type(structure_t), allocatable, intent(in) :: change            !! derivative of the structure by a value
      real(wp), parameter :: dense_fill = 0.5_wp                      ! fill ratio of a matrix
      integer :: half_bandwidth, n_interior

      self%positions = coordinates%positions
      self%interior = all_but(coordinates%positions, structure%n_dofs)
      n_interior = size(self%interior)
      self%loads = loads
      self%loads%values = coordinates%forces_in(loads%values)
      call new_amplitudes(self%load_slopes, structure%n_dofs, loads%n_harmonics)
      if (load_slopes%n_dofs > 0) then
         self%load_slopes = load_slopes
         self%load_slopes%values = coordinates%forces_in(load_slopes%values)
      end if
      call find_blocks(self, structure, coordinates, self%interior)
      half_bandwidth = half_bandwidth_of(self, n_interior)
      if (allocated(change)) then
         allocate (self%change)
         call find_blocks(self%change, change, coordinates, self%interior)
         half_bandwidth = max(half_bandwidth, half_bandwidth_of(self%change, n_interior))
      end if
      call new_block_pattern(self%pattern, coordinates%n, half_bandwidth)
      call new_block_solver(self%solver, self%rr, n_interior, coordinates%n + 1, highest_frequency)
      self%highest_frequency = highest_frequency
      allocate (self%s_rl(self%rl%n_entries), self%s_lr(self%lr%n_entries))
      if (coordinates%n > 1 .and. .not. self%pattern%is_banded .and. self%lr%n_entries > dense_fill*coordinates%n*n_interior) &
         allocate (self%full_lr(coordinates%n, n_interior), source=(0.0_wp, 0.0_wp))
   end subroutine new_condensation

   !> Must be called before some harmonics are eliminated, `end` afterwards; returns the order in which they take the least time.
   subroutine condensation_begin(self, harmonics, frequencies, drives, order)
      class(condensation_t), intent(inout) :: self
      integer, intent(in) :: harmonics(:)                             !! their numbers, (n)
      real(wp), intent(in) :: frequencies(:), drives(:)               !! [rad/s], [rad**2/s**2], of all harmonics
      integer, intent(out) :: order(:)                                !! positions in `harmonics`, (n)
      integer, parameter :: n_first = 8                               ! harmonics whose solutions are found together
      complex(wp), allocatable :: forces(:, :, :)
      integer :: chosen(min(n_first, size(harmonics))), i, k, n

      n = size(harmonics)
      order = [(i, i=1, n)]
      call self%solver%begin(n)
      if (.not. self%solver%prefers_space()) return
      order = descending(abs(frequencies(harmonics)))
      chosen = harmonics(order([(1 + ((n - 1)*(i - 1))/max(1, size(chosen) - 1), i=1, size(chosen))]))
      allocate (forces(size(self%interior), size(self%positions) + 1, size(chosen)))
      do i = 1, size(chosen)
         k = findloc(self%loads%harmonics, chosen(i), dim=1)
         call self%rl%evaluate(frequencies(chosen(i)), drives(chosen(i)), self%s_rl)
         call store_forces(self, k, forces(:, :, i))
      end do
      call self%solver%learn(frequencies(chosen), drives(chosen), forces)
   end subroutine condensation_begin

   !> Frees the memory that eliminations took.
   subroutine condensation_end(self)
      class(condensation_t), intent(inout) :: self

      call self%solver%end()
   end subroutine condensation_end

   !> Positions of numbers in descending order; equal ones remain in their order.
   pure function descending(numbers) result(order)
      real(wp), intent(in) :: numbers(:)
      integer :: order(size(numbers)), i, k

      do i = 1, size(numbers)                                         ! insertion sort: solutions take far longer
         k = i
         do while (k > 1)
            if (numbers(order(k - 1)) >= numbers(i)) exit
            order(k) = order(k - 1)
            k = k - 1
         end do
         order(k) = i
      end do
   end function descending

   !> Eliminates the interior of harmonic h: computes P_c, and stores T, y and the entries of S_lr; between `begin` and `end`.
   subroutine condensation_eliminate(self, h, frequency, drive, load, magnitude, is_singular)
      class(condensation_t), intent(inout) :: self
      integer, intent(in) :: h
      real(wp), intent(in) :: frequency                               !! [rad/s]
      real(wp), intent(in) :: drive                                   !! [rad**2/s**2]
      complex(wp), intent(out), contiguous :: load(:)
      real(wp), intent(out) :: magnitude(:)                           !! diagonal of S_ll [N/m] before cancellation
      logical, intent(out) :: is_singular
      integer :: e, k, n_law

      n_law = size(self%positions)
      self%drive = drive
      if (allocated(self%tuples)) call set_tuple(self, self%tuples(:, h))
      k = findloc(self%loads%harmonics, h, dim=1)
      associate (ll => self%ll, lr => self%lr, rl => self%rl, solver => self%solver)
         call rl%evaluate(frequency, drive, self%s_rl)
         call solve_interior(self, k, frequency, is_singular)
         if (is_singular) return

         self%transfer = solver%rhs(:, :n_law)
         self%held_motion = solver%rhs(:, n_law + 1)
         call ll%diagonal_magnitude(frequency, magnitude)
         load = (0.0_wp, 0.0_wp)
         if (k > 0) load = self%loads%values(self%positions, k)
         call lr%evaluate(frequency, drive, self%s_lr)
         do e = 1, lr%n_entries
            load(lr%row(e)) = load(lr%row(e)) - self%s_lr(e)*self%held_motion(lr%column(e))
         end do
      end associate
   end subroutine condensation_eliminate

   !> Sets the tuple of a harmonic in all blocks.
   pure subroutine set_tuple(self, tuple)
      class(condensation_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)

      call self%ll%set_tuple(tuple)
      call self%lr%set_tuple(tuple)
      call self%rl%set_tuple(tuple)
      call self%solver%set_tuple(tuple)
      if (.not. allocated(self%change)) return
      call self%change%ll%set_tuple(tuple)
      call self%change%lr%set_tuple(tuple)
      call self%change%rl%set_tuple(tuple)
      call self%change%rr%set_tuple(tuple)
   end subroutine set_tuple

   !> S_c of the harmonic whose interior was eliminated last.
   subroutine condensation_get_block(self, frequency, condensed)
      class(condensation_t), intent(inout) :: self
      real(wp), intent(in) :: frequency                               !! [rad/s]
      complex(wp), intent(out), contiguous :: condensed(:, :)         !! as `pattern` defines it
      complex(wp), parameter :: one = (1.0_wp, 0.0_wp)
      integer :: e, n_interior, n_law

      n_law = size(self%positions)
      n_interior = size(self%interior)
      if (.not. allocated(self%s_ll)) allocate (self%s_ll(self%ll%n_entries))
      associate (ll => self%ll, lr => self%lr, s_lr => self%s_lr)
         call ll%evaluate(frequency, self%drive, self%s_ll)
         condensed = (0.0_wp, 0.0_wp)
         do e = 1, ll%n_entries
            condensed(self%pattern%shift(ll%column(e)) + ll%row(e), ll%column(e)) = self%s_ll(e)
         end do
         if (allocated(self%full_lr)) then
            do e = 1, lr%n_entries
               self%full_lr(lr%row(e), lr%column(e)) = s_lr(e)
            end do
            call zgemm("N", "N", n_law, n_law, n_interior, -one, self%full_lr, n_law, self%transfer, n_interior, one, &
                       condensed, n_law)
         else
            do e = 1, lr%n_entries
               call subtract_row(self%pattern, condensed, lr%row(e), s_lr(e), self%transfer(lr%column(e), :))
            end do
         end if
      end associate
   end subroutine condensation_get_block

   !> Whether harmonics can share the matrices between the coordinates: all their entries are there, none depends on the frequency
   !> in another way, and the interior is small.
   pure logical function condensation_can_share(self, n_harmonics) result(can_share)
      class(condensation_t), intent(in) :: self
      integer, intent(in) :: n_harmonics

      can_share = .not. (self%pattern%is_banded .or. allocated(self%change) .or. allocated(self%ll%parts))
      if (can_share) can_share = pays_to_share(size(self%positions), size(self%interior), n_harmonics)
   end function condensation_can_share

   !> The part of S_c that all harmonics share.
   subroutine condensation_begin_shared(self, frequencies, shared)
      class(condensation_t), intent(in) :: self
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      type(shared_stiffness_t), intent(out) :: shared

      call new_shared_stiffness(shared, self%ll, size(self%positions), size(self%interior), frequencies)
   end subroutine condensation_begin_shared

   !> Adds what the interior does in the harmonic in which it was eliminated last.
   subroutine condensation_add_to_shared(self, h, shared)
      class(condensation_t), intent(in) :: self
      integer, intent(in) :: h
      type(shared_stiffness_t), intent(inout) :: shared
      integer :: e

      shared%transfer(:, :, h) = self%transfer
      do e = 1, self%lr%n_entries
         shared%coupling(self%lr%row(e), self%lr%column(e), h) = self%s_lr(e)
      end do
   end subroutine condensation_add_to_shared

   !> Solves for T and y of a harmonic. The mean value of a motion that nothing restrains is zero at one degree of freedom, if
   !> forces of the coordinates and loads are in equilibrium.
   subroutine solve_interior(self, k, frequency, is_singular)
      class(condensation_t), intent(inout) :: self
      integer, intent(in) :: k                                        !! of the loads; 0: none
      real(wp), intent(in) :: frequency                               !! [rad/s]
      logical, intent(out) :: is_singular
      real(wp) :: limit, reciprocal_condition

      associate (solver => self%solver, n_law => size(self%positions))
         limit = max(lowest_condition, real(size(self%interior), wp)*epsilon(1.0_wp))
         call store_forces(self, k, solver%rhs(:, :n_law + 1))
         call solver%solve(frequency, self%drive, reciprocal_condition)
         is_singular = reciprocal_condition < limit
         if (abs(frequency) > 0.0_wp) return
         if (is_singular .and. .not. allocated(solver%held)) then
            call hold_free(self, limit, is_singular)
            if (is_singular) return
            call store_forces(self, k, solver%rhs(:, :n_law + 1))
            call solver%solve(frequency, self%drive, reciprocal_condition)
            is_singular = reciprocal_condition < limit
         end if
         if (is_singular .or. .not. allocated(solver%held)) return
         is_singular = any(solver%unsupported > free_force)
         if (solver%unsupported(n_law + 1) > free_force) &
            self%drifting = self%interior(solver%held(maxloc(abs(solver%rhs(solver%held, n_law + 1)), dim=1)))
      end associate
   end subroutine solve_interior

   !> The right-hand sides of the interior: columns of S_rl, which has been evaluated, and the loads.
   pure subroutine store_forces(self, k, rhs)
      class(condensation_t), intent(in) :: self
      integer, intent(in) :: k                                        !! of the loads; 0: none
      complex(wp), intent(out) :: rhs(:, :)                           !! (n_interior, n_law + 1)
      integer :: e

      rhs = (0.0_wp, 0.0_wp)
      do e = 1, self%rl%n_entries
         rhs(self%rl%row(e), self%rl%column(e)) = self%s_rl(e)
      end do
      if (k > 0) rhs(:, size(rhs, 2)) = self%loads%values(self%interior, k)
   end subroutine store_forces

   !> Holds the free motions of the interior at zero frequency; not if they exert forces on the coordinates.
   subroutine hold_free(self, limit, is_singular)
      class(condensation_t), intent(inout) :: self
      real(wp), intent(in) :: limit                                   !! of the reciprocal condition
      logical, intent(out) :: is_singular
      complex(wp) :: forces(size(self%positions), 2)                  ! their sums, and the sums of their magnitudes
      logical :: is_done
      integer :: e, i

      associate (solver => self%solver, lr => self%lr)
         call solver%hold_free(self%highest_frequency, limit, is_done)
         is_singular = .not. is_done
         if (is_singular) return
         call lr%evaluate(0.0_wp, self%drive, self%s_lr)
         do i = 1, size(solver%held)
            solver%rhs = (0.0_wp, 0.0_wp)
            solver%rhs(solver%held(i), 1) = (1.0_wp, 0.0_wp)
            call solver%solve_again()                                 ! a free motion
            forces = (0.0_wp, 0.0_wp)
            do e = 1, lr%n_entries
               associate (force => self%s_lr(e)*solver%rhs(lr%column(e), 1))
                  forces(lr%row(e), 1) = forces(lr%row(e), 1) + force
                  forces(lr%row(e), 2) = forces(lr%row(e), 2) + abs(force)
               end associate
            end do
            is_singular = is_singular .or. any(abs(forces(:, 1)) > free_force*abs(forces(:, 2)))
         end do
      end associate
   end subroutine hold_free

   !> Degrees of freedom whose mean value nothing determines, and which is zero in the last harmonic.
   pure function condensation_free_dofs(self) result(dofs)
      class(condensation_t), intent(in) :: self
      integer, allocatable :: dofs(:)

      allocate (dofs(0))
      if (allocated(self%solver%held)) dofs = self%interior(self%solver%held)
   end function condensation_free_dofs

   !> Entries of the structure between coordinates and interior.
   subroutine find_blocks(blocks, structure, coordinates, interior)
      class(blocks_t), intent(inout) :: blocks
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      integer, intent(in) :: interior(:)

      if (coordinates%are_dofs) then
         call find_in(structure)
      else
         call find_in(coordinates%structure_in(structure))
      end if

   contains

      subroutine find_in(turned)
         type(structure_t), intent(in) :: turned

         associate (positions => coordinates%positions)
            call new_structure_block(blocks%ll, turned, positions, positions)
            call new_structure_block(blocks%lr, turned, positions, interior)
            call new_structure_block(blocks%rl, turned, interior, positions)
            call new_structure_block(blocks%rr, turned, interior, interior)
         end associate
      end subroutine find_in
   end subroutine find_blocks

   !> Derivatives of S_c and P_c of harmonic h with respect to the frequency, to a value on which the structure also
   !> depends, or to the drive, from its T and y and with their factors; those of T and y, (n_interior, n_law + 1),
   !> are returned in `solver%rhs`.
   subroutine condensation_find_slopes(self, h, frequency, by_drive, condensed, load)
      class(condensation_t), intent(inout) :: self                    !! after `condense` of harmonic h
      integer, intent(in) :: h
      real(wp), intent(in) :: frequency                               !! [rad/s]
      logical, intent(in) :: by_drive
      complex(wp), intent(out) :: condensed(:, :), load(:)
      real(wp) :: rate
      integer :: e, k, n

      n = size(self%positions)
      k = 0
      if (.not. by_drive) k = findloc(self%load_slopes%harmonics, h, dim=1)
      if (.not. allocated(self%load_slope)) allocate (self%load_slope(self%load_slopes%n_dofs))
      self%load_slope = (0.0_wp, 0.0_wp)
      if (k > 0) self%load_slope = self%load_slopes%values(:, k)
      associate (solver => self%solver, s_lr => self%s_lr, lr => self%lr)
         ! dT = S_rr^-1 (dS_rl - dS_rr T), dy = S_rr^-1 (dP_r - dS_rr y)
         ! dS_c = dS_ll - dS_lr T - S_lr dT, dP_c = dP_l - dS_lr y - S_lr dy
         solver%rhs = (0.0_wp, 0.0_wp)
         solver%rhs(:, n + 1) = self%load_slope(self%interior)
         condensed = (0.0_wp, 0.0_wp)
         load = self%load_slope(self%positions)
         if (by_drive) then
            call add_slopes(self, self, slope_by%drive, frequency, 1.0_wp, condensed, load)
         else
            rate = 1.0_wp
            if (allocated(self%rates)) rate = self%rates(h)
            call add_slopes(self, self, slope_by%frequency, frequency, rate, condensed, load)
            if (allocated(self%drive_rates)) call add_slopes(self, self, slope_by%drive, frequency, self%drive_rates(h), &
                                                             condensed, load)
            if (allocated(self%change)) call add_slopes(self, self%change, slope_by%value, frequency, 1.0_wp, condensed, load)
         end if
         call solver%solve_again()
         do e = 1, lr%n_entries
            call subtract_row(self%pattern, condensed, lr%row(e), s_lr(e), solver%rhs(lr%column(e), :n))
            load(lr%row(e)) = load(lr%row(e)) - s_lr(e)*solver%rhs(lr%column(e), n + 1)
         end do
         if (allocated(self%change) .and. allocated(solver%held) .and. .not. abs(frequency) > 0.0_wp) then
            if (any(maxval(abs(solver%rhs(solver%held, :n + 1)), dim=1) > free_force*maxval(abs(solver%rhs(:, :n + 1)), dim=1))) &
               load = ieee_value(1.0_wp, ieee_quiet_nan)              ! the value would support, or load, a free motion
         end if
      end associate
   end subroutine condensation_find_slopes

   !> Adds the contributions of some blocks to the derivatives of S_c and P_c, except S_lr dT and S_lr dy, and the
   !> right-hand sides of the latter.
   subroutine add_slopes(self, blocks, by, frequency, rate, condensed, load)
      class(condensation_t), intent(inout), target :: self
      class(blocks_t), intent(in) :: blocks
      integer, intent(in) :: by                                       !! one of `slope_by`
      real(wp), intent(in) :: frequency                               !! [rad/s]
      real(wp), intent(in) :: rate                                    !! derivative of the frequency, or of the drive
      complex(wp), intent(inout) :: condensed(:, :), load(:)
      complex(wp), allocatable :: slope(:)
      integer :: e, k, n

      n = size(self%positions)
      associate (rhs => self%solver%rhs, transfer => self%transfer, held_motion => self%held_motion, &
                 rl => blocks%rl, rr => blocks%rr, ll => blocks%ll, lr => blocks%lr, shift => self%pattern%shift)
         allocate (slope, source=slopes_of(rl))
         do e = 1, rl%n_entries
            rhs(rl%row(e), rl%column(e)) = rhs(rl%row(e), rl%column(e)) + slope(e)
         end do
         slope = slopes_of(rr)
         do e = 1, rr%n_entries
            rhs(rr%row(e), :n) = rhs(rr%row(e), :n) - slope(e)*transfer(rr%column(e), :)
            rhs(rr%row(e), n + 1) = rhs(rr%row(e), n + 1) - slope(e)*held_motion(rr%column(e))
         end do
         slope = slopes_of(ll)
         do e = 1, ll%n_entries
            k = shift(ll%column(e)) + ll%row(e)
            condensed(k, ll%column(e)) = condensed(k, ll%column(e)) + slope(e)
         end do
         slope = slopes_of(lr)
         do e = 1, lr%n_entries
            call subtract_row(self%pattern, condensed, lr%row(e), slope(e), transfer(lr%column(e), :))
            load(lr%row(e)) = load(lr%row(e)) - slope(e)*held_motion(lr%column(e))
         end do
      end associate

   contains

      function slopes_of(block) result(slope)
         type(structure_block_t), intent(in) :: block
         complex(wp) :: slope(block%n_entries)

         if (by == slope_by%value) then
            call block%evaluate(frequency, self%drive, slope)
         else if (by == slope_by%drive) then
            call block%drive_slope(slope)
         else
            call block%slope(frequency, slope)
         end if
         if (by /= slope_by%value) slope = rate*slope
      end function slopes_of
   end subroutine add_slopes

   !> Subtracts factor*values from row i of a block; outside its pattern the values are zero.
   pure subroutine subtract_row(pattern, block, i, factor, values)
      type(block_pattern_t), intent(in) :: pattern
      complex(wp), intent(inout) :: block(:, :)                       !! (n_rows, n)
      integer, intent(in) :: i
      complex(wp), intent(in) :: factor, values(:)                    !! (n)
      integer :: k

      do k = pattern%first(i), pattern%last(i)
         block(pattern%shift(k) + i, k) = block(pattern%shift(k) + i, k) - factor*values(k)
      end do
   end subroutine subtract_row

   !> Largest distance between two coordinates, by their numbers, that the condensed stiffness couples.
   integer function condensed_half_bandwidth(structure, coordinates) result(half_bandwidth)
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(blocks_t) :: blocks
      integer, allocatable :: interior(:)

      allocate (interior, source=all_but(coordinates%positions, structure%n_dofs))
      call find_blocks(blocks, structure, coordinates, interior)
      half_bandwidth = half_bandwidth_of(blocks, size(interior))
   end function condensed_half_bandwidth

   !> Largest distance between two law dofs that S_c couples: directly, or through connected interior dofs.
   pure integer function half_bandwidth_of(blocks, n_interior) result(half_bandwidth)
      class(blocks_t), intent(in) :: blocks
      integer, intent(in) :: n_interior
      integer, allocatable :: lowest(:), highest(:), part(:)
      integer :: a, b, e, i

      associate (ll => blocks%ll, lr => blocks%lr, rl => blocks%rl, rr => blocks%rr)
         half_bandwidth = 0
         do e = 1, ll%n_entries
            half_bandwidth = max(half_bandwidth, abs(ll%row(e) - ll%column(e)))
         end do
         if (n_interior == 0) return
         part = [(i, i=1, n_interior)]                          ! each dof points to one of its component, the first to itself
         do e = 1, rr%n_entries
            a = first_of(part, rr%row(e))
            b = first_of(part, rr%column(e))
            part(max(a, b)) = min(a, b)
         end do
         allocate (lowest(n_interior), source=huge(1))
         allocate (highest(n_interior), source=0)
         do e = 1, lr%n_entries
            a = first_of(part, lr%column(e))
            lowest(a) = min(lowest(a), lr%row(e))
            highest(a) = max(highest(a), lr%row(e))
         end do
         do e = 1, rl%n_entries
            a = first_of(part, rl%row(e))
            lowest(a) = min(lowest(a), rl%column(e))
            highest(a) = max(highest(a), rl%column(e))
         end do
         do i = 1, n_interior
            if (highest(i) > 0) half_bandwidth = max(half_bandwidth, highest(i) - lowest(i))
         end do
      end associate
   end function half_bandwidth_of

   pure integer function first_of(part, member)
      integer, intent(in) :: part(:), member

      first_of = member
      do while (part(first_of) /= first_of)
         first_of = part(first_of)
      end do
   end function first_of

   !> Numbers 1 to n that are not in `chosen`, ascending.
   pure function all_but(chosen, n) result(others)
      integer, intent(in) :: chosen(:), n
      integer, allocatable :: others(:)
      logical :: is_other(n)
      integer :: i

      is_other = .true.
      is_other(chosen) = .false.
      others = pack([(i, i=1, n)], is_other)
   end function all_but
end module hb_condensation
