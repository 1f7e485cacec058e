!> The linearised equations along a known motion: the evolution of a small disturbance.
!>
!> The state is (q, v/scale, positions of sliders). The derivatives of the laws along the motion are the coefficients,
!> which are smooth on each piece of time (hb_variation_pieces). A slider that slips is on its bound and has no memory
!> of its own; one that sticks keeps its position.
module hb_variation
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_coordinate_scales, only: coordinate_scales_t, find_coordinate_scales
   use hb_error, only: error_t, fail
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_lapack, only: dpotrf, dpotrs
   use hb_law, only: law_box_t
   use hb_massless, only: massless_t, new_massless
   use hb_matrix_exponential, only: count_exponential, work_of_product
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_motion_window, only: motion_window_t
   use hb_structure, only: max_dense, structure_t
   use hb_thresholds, only: difference_step, negligible_share, rounding_level, small_share
   implicit none
   private
   public :: min_work, new_variation, piece_t, variation_t

   !> An interval of time without events inside.
   type :: piece_t
      real(wp) :: start = 0.0_wp, finish = 0.0_wp                     !! [s]
      logical :: is_after_event = .false., is_before_event = .false.
      integer, allocatable :: slip(:)                                 !! (n_states) 1 on the lower bound, -1 on the upper, 0 sticks
      real(wp), allocatable :: held(:)                                !! (n_states) position of sliders that stick
      real(wp), allocatable :: by_displacement(:, :, :), by_rate(:, :, :), by_state(:, :, :) !! slopes of the laws at nodes
   end type piece_t

   !> Position of a law in the lists of all laws.
   type :: span_t
      integer :: first = 0, last = 0                                  !! coordinates
      integer :: first_state = 1, last_state = 0
   end type span_t

   type :: variation_t
      integer :: n_dofs = 0
      integer :: n_states = 0                                         !! sliders of all laws
      integer :: n_coordinates = 0                                    !! of all laws
      integer :: size = 0                                             !! of the state
      real(wp) :: scale = 1.0_wp                                      !! of velocities [1/s]
      real(wp) :: norm = 0.0_wp                                       !! of the constant part [1/s]
      real(wp), allocatable :: slider_unit(:)                         !! of their positions in the state: as of degrees of freedom
      type(motion_series_t) :: motion                                 !! of the coordinates
      integer, allocatable :: slip(:)                                 !! at the end of the last piece
      real(wp), allocatable :: held(:)
      logical, allocatable :: has_slipped(:)                          !! (n_states) in any piece so far
      type(law_box_t), allocatable :: laws(:)
      type(span_t), allocatable :: spans(:)
      real(wp), allocatable :: constant(:, :)                         !! A of the structure alone, (size, size)
      real(wp), allocatable, private :: energy(:, :)                  ! of a state in the structure, (2 n_dofs, 2 n_dofs)
      real(wp), allocatable :: accelerance(:, :), shape(:, :)         !! M^-1 S and S, (n_dofs, n_coordinates)
      real(wp), allocatable :: noise(:, :)                            !! density of white noise in the state, (size, size); none
      type(massless_t), allocatable :: massless                       !! of a structure with degrees of freedom without mass
      real(wp) :: detection_frequency = 0.0_wp !! highest frequency that carries the motion, for events [rad/s]
      real(wp), allocatable :: extent(:)                              !! amplitude of the motion of each coordinate [m]
      logical, private :: has_turning = .false.
      logical, private :: needs_rates = .false.                       ! switches, sliders or slopes of a law
      type(motion_window_t), private :: window                        ! the motion in the present interval
   contains
      procedure :: enter => variation_enter
      procedure :: size_of => variation_size_of
      procedure :: find_motion => variation_find_motion
      procedure :: matrix_at => variation_matrix_at
      procedure :: find_slopes => variation_find_slopes
      procedure :: find_bound_slopes => variation_find_bound_slopes
      procedure :: is_smooth => variation_is_smooth
      procedure :: is_piecewise_linear => variation_is_piecewise_linear
      procedure :: n_switches => variation_n_switches
      procedure :: work_of_node => variation_work_of_node
      procedure :: work_of_step => variation_work_of_step
   end type variation_t

contains

   !> Fails for a mass that is singular elsewhere than at degrees of freedom without any, for rigid laws and for laws with memory
   !> without bounds.
   subroutine new_variation(self, structure, laws, tuples, omega, amplitudes, error)
      type(variation_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! of the motion, cos - i sin, (n_dofs, n_harmonics)
      type(error_t), allocatable, intent(out) :: error
      type(coordinate_scales_t) :: scales
      integer :: i, n

      call structure%check_matrices("stability", max_dense, error)
      if (allocated(error)) return
      n = structure%n_dofs
      self%n_dofs = n
      self%laws = laws
      allocate (self%spans(size(laws)))
      do i = 1, size(laws)
         associate (law => self%laws(i)%law, span => self%spans(i))
            if (law%is_multiplier) then
               call fail(error, "law '"//law%label//"' is rigid and has no derivative")
               return
            end if
            span%first = self%n_coordinates + 1
            self%n_coordinates = self%n_coordinates + size(law%shape, 2)
            span%last = self%n_coordinates
            self%has_turning = self%has_turning .or. law%n_phases > 0
            self%needs_rates = self%needs_rates .or. law%needs_velocity .or. law%n_states > 0
            if (law%needs_frequencies) call law%set_frequencies(omega)
            select type (law)
            class is (hysteretic_law_t)
               if (.not. law%has_bounds) then
                  call fail(error, "the memory of law '"//law%label//"' has no bounds that can be followed")
                  return
               end if
               span%first_state = self%n_states + 1
               self%n_states = self%n_states + law%n_states
               span%last_state = self%n_states
            end select
         end associate
      end do
      self%size = 2*n + self%n_states
      allocate (self%shape(n, self%n_coordinates), source=0.0_wp)
      allocate (self%slider_unit(self%n_states))
      do i = 1, size(laws)
         associate (span => self%spans(i), shape => laws(i)%law%shape)
            self%shape(laws(i)%law%dofs, span%first:span%last) = shape
            ! a power of two changes no digit
            self%slider_unit(span%first_state:span%last_state) = set_exponent(1.0_wp, exponent(maxval(norm2(shape, dim=1))))
         end associate
      end do
      call new_motion_series(self%motion, tuples, omega, matmul(transpose(self%shape), amplitudes))
      self%extent = max(sum(abs(self%motion%amplitudes), dim=2), tiny(1.0_wp))
      self%detection_frequency = carrying_frequency(self)
      allocate (self%slip(self%n_states), source=0)
      allocate (self%held(self%n_states), source=0.0_wp)
      allocate (self%has_slipped(self%n_states), source=.false.)
      call divide_by_mass(self, structure, error)
      if (allocated(error)) return
      call find_coordinate_scales(scales, structure, laws, minval(abs(omega)), sum(abs(amplitudes), dim=2))
      call find_energy(self, structure, scales%equations)
   end subroutine new_variation

   !> The frequency beyond which the motion of each coordinate is negligible, so that events due to higher ones are as
   !> well.
   pure real(wp) function carrying_frequency(self) result(frequency)
      type(variation_t), intent(in) :: self
      integer, parameter :: n_parts = 64
      integer :: c, part

      associate (frequencies => abs(self%motion%frequencies), amplitudes => abs(self%motion%amplitudes))
         do part = n_parts, 1, -1
            frequency = maxval(frequencies)*part/n_parts
            do c = 1, self%n_coordinates
               if (sum(amplitudes(c, :), mask=frequencies > maxval(frequencies)*(part - 1)/n_parts) > negligible_share* &
                     self%extent(c)) return
            end do
         end do
      end associate
   end function carrying_frequency

   subroutine divide_by_mass(self, structure, error)
      type(variation_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%n_dofs, self%n_dofs) :: damping, stiffness
      real(wp), allocatable :: factor(:, :)
      integer :: i, info, n

      n = self%n_dofs
      call structure%factorise_mass(factor, info)
      if (info /= 0) then
         call leave_out_massless(self, structure, error)
         return
      end if
      stiffness = structure%stiffness
      damping = structure%damping
      self%accelerance = self%shape
      call dpotrs("L", n, n, factor, n, stiffness, n, info)
      call dpotrs("L", n, n, factor, n, damping, n, info)
      if (size(self%accelerance) > 0) call dpotrs("L", n, size(self%accelerance, 2), factor, n, self%accelerance, n, info)
      self%scale = sqrt(maxval(sum(abs(stiffness), dim=1)))
      self%scale = max(self%scale, maxval(abs(self%motion%omega)))
      allocate (self%constant(self%size, self%size), source=0.0_wp)
      do i = 1, n
         self%constant(i, n + i) = self%scale
      end do
      self%constant(n + 1:2*n, :n) = -stiffness/self%scale
      self%constant(n + 1:2*n, n + 1:2*n) = -damping
      ! smaller numbers are subnormal, which slows processors down by a factor of a hundred
      where (abs(self%constant) < tiny(1.0_wp)/epsilon(1.0_wp)) self%constant = 0.0_wp
      self%norm = maxval(sum(abs(self%constant), dim=1))
   end subroutine divide_by_mass

   !> Finds the energy by which states are compared in size: the norm of their entries rises and falls as a mode turns
   !> displacements into velocities, which are small in a structure with fast modes. Displacements without stiffness count as on
   !> springs that are soft for the slowest tone. Structures of negative stiffness have none: their coordinates count by themselves.
   subroutine find_energy(self, structure, factors)
      type(variation_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: factors(:)                              !! of equations, with which forces are reciprocal
      real(wp), allocatable :: factor(:, :), potential(:, :)
      real(wp) :: slowest
      integer :: i, info

      slowest = minval(abs(self%motion%omega))
      associate (n => self%n_dofs, rows => spread(factors, 2, self%n_dofs))
         allocate (potential, source=symmetric_part(rows*(structure%stiffness + (small_share*slowest)**2*structure%mass)))
         if (allocated(self%massless)) call count_massless(self%massless, factors, slowest, potential)
         allocate (factor, source=potential)
         call dpotrf("L", n, factor, n, info)
         if (info /= 0) then
            potential = 0.0_wp
            do i = 1, n
               potential(i, i) = factors(i)*(abs(structure%stiffness(i, i)) + slowest*abs(structure%damping(i, i)) &
                                             + (small_share*slowest)**2*structure%mass(i, i))
            end do
         end if
         allocate (self%energy(2*n, 2*n), source=0.0_wp)
         self%energy(:n, :n) = potential
         self%energy(n + 1:, n + 1:) = self%scale**2*symmetric_part(rows*structure%mass)
      end associate
   end subroutine find_energy

   !> Coordinates without mass whose couplings by displacements are not reciprocal, such as currents and pressures, store the energy
   !> of their rates: an inductance, a compressibility. Those of nodes between springs are a part of the potential.
   pure subroutine count_massless(massless, factors, slowest, potential)
      type(massless_t), intent(in) :: massless
      real(wp), intent(in) :: factors(:)
      real(wp), intent(in) :: slowest                                 !! tone [rad/s]
      real(wp), intent(inout) :: potential(:, :)
      real(wp) :: forth, back
      integer :: i, k
      logical :: is_node

      do i = 1, size(factors)
         if (.not. massless%is_inert(size(factors) + i)) cycle
         is_node = .true.
         do k = 1, size(factors)
            forth = factors(k)*massless%stiffness(k, i)
            back = factors(i)*massless%stiffness(i, k)
            if (abs(forth - back) > rounding_level*max(abs(forth), abs(back))) is_node = .false.
         end do
         associate (by_rate => slowest*factors(i)*abs(massless%damping(i, i)))
            if (is_node) then
               potential(i, i) = potential(i, i) + negligible_share*by_rate
            else
               potential(i, :) = 0.0_wp
               potential(:, i) = 0.0_wp
               potential(i, i) = merge(by_rate, factors(i)*abs(massless%stiffness(i, i)), by_rate > 0.0_wp)
            end if
         end associate
      end do
   end subroutine count_massless

   pure function symmetric_part(matrix) result(part)
      real(wp), intent(in) :: matrix(:, :)
      real(wp) :: part(size(matrix, 1), size(matrix, 2))

      part = 0.5_wp*(matrix + transpose(matrix))
   end function symmetric_part

   !> The size of a disturbance: the root of its energy.
   pure real(wp) function variation_size_of(self, state) result(length)
      class(variation_t), intent(in) :: self
      real(wp), intent(in) :: state(:)                                !! (size)

      associate (mechanical => state(:size(self%energy, 1)))
         length = sqrt(max(0.0_wp, dot_product(mechanical, matmul(self%energy, mechanical))))
      end associate
   end function variation_size_of

   !> As `divide_by_mass`, with degrees of freedom without mass.
   subroutine leave_out_massless(self, structure, error)
      type(variation_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: none(self%n_dofs, self%n_states), unscaled(self%size, self%size)

      allocate (self%massless)
      call new_massless(self%massless, structure, self%laws, error)
      if (allocated(error)) return
      none = 0.0_wp
      allocate (self%constant(self%size, self%size), self%accelerance(self%n_dofs, self%n_coordinates), source=0.0_wp)
      call self%massless%state_matrix(1.0_wp, self%massless%stiffness, self%massless%damping, none, unscaled)
      self%scale = maxval(abs(self%motion%omega))
      if (all(ieee_is_finite(unscaled))) &
         self%scale = max(self%scale, sqrt(maxval(abs(unscaled(self%n_dofs + 1:, :self%n_dofs)))))
      call self%massless%state_matrix(self%scale, self%massless%stiffness, self%massless%damping, none, self%constant)
      self%norm = max(self%scale, maxval(sum(abs(self%constant), dim=1), mask=ieee_is_finite(sum(self%constant, dim=1))))
   end subroutine leave_out_massless

   !> Prepares for many times of an interval.
   subroutine variation_enter(self, start, finish)
      class(variation_t), intent(inout) :: self
      real(wp), intent(in) :: start, finish                           !! [s]

      call self%window%cover(self%motion, start, finish, self%needs_rates)
   end subroutine variation_enter

   !> Coordinates at several times, and their rates if a law needs them, otherwise 0.
   pure subroutine variation_find_motion(self, times, z, v)
      class(variation_t), intent(in) :: self
      real(wp), intent(in) :: times(:)                                !! [s]
      real(wp), intent(out) :: z(:, :), v(:, :)                       !! (n_times, n_coordinates)

      if (self%window%covers(times)) then
         call self%window%at(times, z, v)
      else
         call self%motion%at(self%motion%phases(times), z, v, self%needs_rates)
      end if
   end subroutine variation_find_motion

   !> Whether no law has a memory or kinks.
   pure logical function variation_is_smooth(self) result(is_smooth)
      class(variation_t), intent(in) :: self
      integer :: i

      is_smooth = self%n_states == 0 .and. all([(self%laws(i)%law%n_switches == 0, i=1, size(self%laws))])
   end function variation_is_smooth

   !> Number of switches and sliders of all laws, each of which causes events.
   pure integer function variation_n_switches(self) result(n)
      class(variation_t), intent(in) :: self
      integer :: i

      n = sum([(self%laws(i)%law%n_switches + self%laws(i)%law%n_states, i=1, size(self%laws))])
   end function variation_n_switches

   !> Whether the slopes of all laws are constant on each piece.
   pure logical function variation_is_piecewise_linear(self) result(is_linear)
      class(variation_t), intent(in) :: self
      integer :: i

      is_linear = all([(self%laws(i)%law%is_piecewise_linear .and. self%laws(i)%law%n_switches + self%laws(i)%law%n_states > 0, &
                        i=1, size(self%laws))])
   end function variation_is_piecewise_linear

   !> A at a node of a piece.
   subroutine variation_matrix_at(self, piece, node, a)
      class(variation_t), intent(in) :: self
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: node
      real(wp), intent(out) :: a(:, :)
      integer :: c, d, i, k, n
      real(wp) :: factor

      n = self%n_dofs
      if (allocated(self%massless)) then
         associate (shape => self%shape, of => self%massless)
            call of%state_matrix(self%scale, of%stiffness + turned(shape, piece%by_displacement(:, :, node)), &
                                 of%damping + turned(shape, piece%by_rate(:, :, node)), &
                                 matmul(shape, piece%by_state(:, :, node)), a)
         end associate
         return
      end if
      a = self%constant
      do d = 1, self%n_coordinates
         do c = 1, self%n_coordinates
            if (abs(piece%by_displacement(c, d, node)) + abs(piece%by_rate(c, d, node)) <= 0.0_wp) cycle
            do k = 1, n
               factor = self%shape(k, d)
               if (.not. abs(factor) > 0.0_wp) cycle
               do i = 1, n
                  a(n + i, k) = a(n + i, k) - self%accelerance(i, c)*(piece%by_displacement(c, d, node)*factor/self%scale)
                  a(n + i, n + k) = a(n + i, n + k) - self%accelerance(i, c)*(piece%by_rate(c, d, node)*factor)
               end do
            end do
         end do
      end do
      do k = 1, self%n_states
         a(n + 1:2*n, 2*n + k) = -matmul(self%accelerance, piece%by_state(:, k, node))/self%scale
      end do
   end subroutine variation_matrix_at

   !> S slopes S^T.
   pure function turned(shape, slopes)
      real(wp), intent(in) :: shape(:, :), slopes(:, :)
      real(wp) :: turned(size(shape, 1), size(shape, 1))

      turned = matmul(shape, matmul(slopes, transpose(shape)))
   end function turned

   !> Slopes of the forces of all laws at the coordinates of the motion, at several times within a piece.
   subroutine variation_find_slopes(self, piece, times, by_displacement, by_rate, by_state)
      class(variation_t), intent(inout) :: self
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: times(:)                                !! [s]
      real(wp), intent(out) :: by_displacement(:, :, :), by_rate(:, :, :) !! (n_coordinates, n_coordinates, n_times)
      real(wp), intent(out) :: by_state(:, :, :)                      !! (n_coordinates, n_states, n_times), for sliders that stick
      real(wp) :: v(size(times), self%n_coordinates), z(size(times), self%n_coordinates)
      real(wp), allocatable :: df_dp(:, :, :), df_dv(:, :, :), df_dz(:, :, :), f(:, :), nothing(:, :)
      integer :: c, d, i, n, n_times

      n_times = size(times)
      by_displacement = 0.0_wp
      by_rate = 0.0_wp
      by_state = 0.0_wp
      call self%find_motion(times, z, v)
      do i = 1, size(self%laws)
         associate (law => self%laws(i)%law, span => self%spans(i))
            n = size(law%shape, 2)
            if (law%n_phases > 0) call law%set_phases(self%motion%phases(times))
            select type (law)
            class is (hysteretic_law_t)
               call find_slopes_with_memory(self, law, span, piece, z(:, span%first:span%last), v(:, span%first:span%last), &
                                            by_displacement, by_state)
            class default
               if (allocated(f)) deallocate (f, df_dz, df_dv, df_dp, nothing)
               allocate (f(n_times, n), df_dz(n_times, n, n), df_dp(n_times, n, 0), nothing(n_times, 0))
               allocate (df_dv(n_times, n, merge(n, 0, law%needs_velocity)))
               df_dv = 0.0_wp
               if (law%needs_velocity) then
                  call law%evaluate(z(:, span%first:span%last), v(:, span%first:span%last), nothing, f, df_dz, df_dv, df_dp)
               else
                  call law%evaluate(z(:, span%first:span%last), nothing, nothing, f, df_dz, df_dv, df_dp)
               end if
               do d = 1, n
                  do c = 1, n
                     by_displacement(span%first + c - 1, span%first + d - 1, :) = df_dz(:, c, d)
                     if (law%needs_velocity) by_rate(span%first + c - 1, span%first + d - 1, :) = df_dv(:, c, d)
                  end do
               end do
            end select
         end associate
      end do
   end subroutine variation_find_slopes

   !> Derivatives of a law with memory: sliders that slip move with their bounds.
   subroutine find_slopes_with_memory(self, law, span, piece, z, v, by_displacement, by_state)
      class(variation_t), intent(in) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(span_t), intent(in) :: span
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: z(:, :), v(:, :)
      real(wp), intent(inout) :: by_displacement(:, :, :), by_state(:, :, :)
      real(wp) :: df_ds(size(z, 1), size(z, 2), law%n_states), df_dz(size(z, 1), size(z, 2), size(z, 2))
      real(wp) :: f(size(z, 1), size(z, 2)), s(size(z, 1), law%n_states), slopes(law%n_states, size(z, 2))
      real(wp), dimension(law%n_states) :: lower, lower_rate, upper, upper_rate
      integer :: c, d, i, k

      associate (slip => piece%slip(span%first_state:span%last_state), held => piece%held(span%first_state:span%last_state), &
                 first => span%first)
         do i = 1, size(z, 1)
            call law%bounds(z(i, :), v(i, :), lower, upper, lower_rate, upper_rate)
            s(i, :) = merge(held, merge(lower, upper, slip > 0), slip == 0)
         end do
         call law%force(z, s, f, df_dz, df_ds)
         do i = 1, size(z, 1)
            by_displacement(first:span%last, first:span%last, i) = df_dz(i, :, :)
            if (any(slip /= 0)) call self%find_bound_slopes(law, span, z(i, :), v(i, :), slip, slopes)
            do k = 1, law%n_states
               do c = 1, size(z, 2)
                  if (slip(k) == 0) then
                     by_state(first + c - 1, span%first_state + k - 1, i) = df_ds(i, c, k)* &
                                                                            self%slider_unit(span%first_state + k - 1)
                  else
                     do d = 1, size(z, 2)
                        by_displacement(first + c - 1, first + d - 1, i) = by_displacement(first + c - 1, first + d - 1, i) &
                                                                    + df_ds(i, c, k)*slopes(k, d)
                     end do
                  end if
               end do
            end do
         end do
      end associate
   end subroutine find_slopes_with_memory

   !> Derivative of the bound of each slipping slider with respect to each coordinate, (n_states, n_coordinates); zero
   !> for those that stick.
   pure subroutine variation_find_bound_slopes(self, law, span, z, v, slip, slopes)
      class(variation_t), intent(in) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(span_t), intent(in) :: span
      real(wp), intent(in) :: z(:), v(:)
      integer, intent(in) :: slip(:)
      real(wp), intent(out) :: slopes(:, :)
      real(wp), dimension(size(slip)) :: above, below, lower, lower_rate, upper, upper_rate
      real(wp) :: other(size(z)), step
      integer :: c

      do c = 1, size(z)
         step = difference_step*self%extent(span%first + c - 1)
         other = z
         other(c) = z(c) + step
         call law%bounds(other, v, lower, upper, lower_rate, upper_rate)
         above = merge(lower, upper, slip > 0)
         other(c) = z(c) - step
         call law%bounds(other, v, lower, upper, lower_rate, upper_rate)
         below = merge(lower, upper, slip > 0)
         slopes(:, c) = merge(0.0_wp, (above - below)/(2.0_wp*step), slip == 0)
      end do
   end subroutine variation_find_bound_slopes

   !> Approximate work of a step of length h in nanoseconds without its nodes, from counts alone.
   pure real(wp) function variation_work_of_step(self, h) result(work)
      class(variation_t), intent(in) :: self
      real(wp), intent(in) :: h                                       !! [s]

      associate (n => real(self%n_dofs, wp), c => real(self%n_coordinates, wp), m => real(self%size, wp))
         work = 2.0_wp*count_exponential(self%size, 0.5_wp*h*self%norm)
         if (self%size > 2) work = work + 2.0_wp*work_of_product(self%size) + c**2*n**2 + 4.0_wp*m**2
      end associate
   end function variation_work_of_step

   !> Least work of a transfer for n_dofs degrees of freedom, in the units of `work_of_step`: half a step.
   pure real(wp) function min_work(n_dofs) result(work)
      integer, intent(in) :: n_dofs

      work = 0.0_wp
      if (n_dofs > 1) work = work_of_product(2*n_dofs)
   end function min_work

   !> Approximate work of a node of a step or of event detection in nanoseconds, from counts alone.
   pure real(wp) function variation_work_of_node(self) result(work)
      class(variation_t), intent(in) :: self

      work = size(self%motion%frequencies)*(1.0_wp + 2.0_wp*self%n_coordinates) + 20.0_wp + 10.0_wp*self%n_coordinates**2
   end function variation_work_of_node
end module hb_variation
