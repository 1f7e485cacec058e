!> Dynamic stiffness S(w) = K - (w**2 + i drive) M + i w D of each harmonic, condensed exactly to the coordinates of the laws.
!>
!> Convention: x(t) = Re(c exp(i w t)), c = a - i b for x = a cos(w t) + b sin(w t), forces likewise. With the
!> coordinates of the laws (l) and the interior, that is all other degrees of freedom (r), S x = P becomes
!>
!>     S_c x_l = P_c,   S_c = S_ll - S_lr T,   P_c = P_l - S_lr y,   T = S_rr^-1 S_rl,   y = S_rr^-1 P_r,
!>     x_r = y - T x_l.
!>
!> This is block elimination, not model reduction: it is exact at every frequency. If requested, the derivatives of
!> S_c and P_c with respect to the frequency and the drive are included, and `move` recomputes all of them at other
!> frequencies; docs/why/theory.md, eq. (17). The drive is zero except for the artificial damping of
!> docs/why/theory.md, section 6.5.
module hb_dynamic_stiffness
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_amplitudes, only: amplitudes_t, as_amplitudes
   use hb_assert, only: assert, asserts_are_on
   use hb_balancing, only: balancing_factors
   use hb_band_factors, only: factorise_band, solve_band
   use hb_block_pattern, only: block_pattern_t, new_block_pattern
   use hb_block_solver, only: probe_vector, suspicious_growth
   use hb_condensation, only: condensation_t, new_condensation
   use hb_contact_flexibility, only: contact_flexibility_t
   use hb_contact_response, only: contact_response_t, new_contact_response
   use hb_coordinates, only: coordinates_t, dofs_as_coordinates
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_lapack, only: zgetrf, zgetrs
   use hb_shared_stiffness, only: shared_stiffness_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   implicit none
   private
   public :: chunk_of_columns, dynamic_stiffness_t, new_contact_stiffness, new_dynamic_stiffness, wanted_slopes_t

   integer, parameter :: chunk_of_columns = 32               !! columns of S_c that are computed at a time

   !> Requested data beside stiffness and loads at the frequencies.
   type :: wanted_slopes_t
      logical :: is_on = .false.                             !! slopes by frequency and drive, and memory for `move`
      logical :: of_motion = .false.                         !! with slopes, also memory for `recover_slope`
      real(wp), allocatable :: drives(:)                     !! [rad**2/s**2], (n_harmonics), otherwise zero
      logical :: of_interior = .true.                        !! memory for `recover` and `map_to_laws`
      logical :: may_share = .false.                         !! S_c may be in `shared` instead of `condensed`; not with slopes
      type(amplitudes_t) :: loads                            !! dP/dw [N s] of loads that depend on the frequency, otherwise
                                                             !! zero; `move` does not change the loads
      type(structure_t), allocatable :: change               !! derivative of the structure by a value; slopes are by it
      real(wp), allocatable :: rates(:)                      !! derivatives of the frequencies by that value, (n_harmonics)
   end type wanted_slopes_t

   type :: dynamic_stiffness_t
      integer :: n_dofs = 0, n_law = 0, n_harmonics = 0
      type(coordinates_t) :: coordinates                     !! of the laws
      type(block_pattern_t) :: pattern                       !! memory layout of S_c
      complex(wp), allocatable :: condensed(:, :, :)         !! S_c [N/m], (pattern%n_rows, n_law, n_harmonics), or
      type(shared_stiffness_t), allocatable :: shared        !! S_c of many coordinates, or
      type(contact_response_t), allocatable :: contacts      !! its inverse with stuck contacts, of many contacts of a whole model.
                                                             !! Where single entries are asked for, the stiffness of these
                                                             !! contacts stands for S_c, and their forces without laws for P_c
      complex(wp), allocatable :: load(:, :)                 !! P_c [N], (n_law, n_harmonics)
      real(wp), allocatable :: magnitude(:, :)               !! diagonal of S_ll [N/m] before cancellation, (n_law, n_harmonics)
      complex(wp), allocatable :: condensed_slope(:, :, :)   !! dS_c/dw [N s/m], as `condensed`, or not allocated
      complex(wp), allocatable :: load_slope(:, :)           !! dP_c/dw [N s], as `load`, or not allocated
      complex(wp), allocatable :: condensed_drive_slope(:, :, :) !! dS_c/ddrive [kg], or not allocated
      complex(wp), allocatable :: load_drive_slope(:, :)     !! dP_c/ddrive [N s**2], or not allocated
      integer, allocatable :: tuples(:, :)                   !! (n_tones, n_harmonics), where S depends on them
      integer, allocatable, private :: interior(:)           ! degrees of freedom that the coordinates do not replace
      complex(wp), allocatable, private :: transfer(:, :, :) ! T, (n_interior, n_law, n_harmonics), or not allocated
      type(amplitudes_t), private :: held_motion             ! y, motion of the interior with the coordinates held fixed
      complex(wp), allocatable, private :: motion_slope(:, :, :, :)   ! dT, dy by frequency and by drive,
                                                             ! (n_interior, n_law + 1, 2, n_harmonics), or not allocated
      class(condensation_t), allocatable, private :: condensation  ! stored with slopes
      integer, allocatable :: free_dofs(:)                   !! of the interior, whose mean values nothing determines: they are zero
   contains
      procedure :: entry => dynamic_stiffness_entry
      procedure :: get_columns => dynamic_stiffness_get_columns
      procedure :: largest_entry => dynamic_stiffness_largest_entry
      procedure :: move => dynamic_stiffness_move
      procedure :: change_contacts => dynamic_stiffness_change_contacts
      procedure :: transfer_to => dynamic_stiffness_transfer_to
      procedure :: adopt_loads => dynamic_stiffness_adopt_loads
      procedure :: restricted_to => dynamic_stiffness_restricted_to
      procedure :: linear_amplitudes => dynamic_stiffness_linear_amplitudes
      procedure :: recover => dynamic_stiffness_recover
      procedure :: recover_slope => dynamic_stiffness_recover_slope
      procedure :: map_to_laws => dynamic_stiffness_map_to_laws
      procedure :: has_interior => dynamic_stiffness_has_interior
   end type dynamic_stiffness_t

   interface new_dynamic_stiffness
      procedure :: condensed_to_dofs, condensed_to_coordinates
   end interface new_dynamic_stiffness

contains

   !> Condenses to degrees of freedom (any order, none for a linear problem); arguments as below.
   subroutine condensed_to_dofs(self, structure, law_dofs, frequencies, loads, error, slopes, tuples)
      type(dynamic_stiffness_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: law_dofs(:)                              !! (n_law)
      real(wp), intent(in) :: frequencies(:)
      complex(wp), intent(in) :: loads(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(wanted_slopes_t), intent(in), optional :: slopes
      integer, intent(in), optional :: tuples(:, :)

      call condensed_to_coordinates(self, structure, dofs_as_coordinates(law_dofs), frequencies, as_amplitudes(loads), error, &
                                    slopes, tuples)
   end subroutine condensed_to_dofs

   !> Condenses `structure` to coordinates at each frequency.
   !>
   !> Fails for degrees of freedom that do not exist or occur twice, for inconsistent sizes, and if the interior is
   !> singular to working precision: at an undamped resonance that the coordinates do not restrain, or at w = 0 under a load
   !> that nothing supports. Otherwise the mean value of a motion that nothing restrains is zero at `free_dofs`.
   subroutine condensed_to_coordinates(self, structure, coordinates, frequencies, loads, error, slopes, tuples)
      type(dynamic_stiffness_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics), of any sign
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      type(error_t), allocatable, intent(out) :: error
      type(wanted_slopes_t), intent(in), optional :: slopes
      integer, intent(in), optional :: tuples(:, :)                   !! (n_tones, n_harmonics), where the structure depends on them
      type(wanted_slopes_t) :: wanted
      class(condensation_t), allocatable :: retained
      type(condensation_t) :: once                                    ! not `allocatable`: several kB, for each point

      call check_input(structure, coordinates%dofs, frequencies, loads, error)
      if (.not. (allocated(error) .or. present(tuples)) .and. structure%depends_on_tuple()) &
         call fail(error, "dynamic stiffness: that of a sector needs the tuples of the harmonics")
      if (allocated(error)) return
      if (present(slopes)) wanted = slopes
      if (.not. allocated(wanted%drives)) wanted%drives = 0.0_wp*frequencies
      if (wanted%is_on) then
         allocate (retained)
         call condense_with(retained)
         call move_alloc(retained, self%condensation)
      else
         call condense_with(once)
      end if

   contains

      subroutine condense_with(condensation)
         type(condensation_t), intent(inout) :: condensation
         integer :: n_interior, n_law

         n_law = coordinates%n
         n_interior = structure%n_dofs - n_law
         self%n_dofs = structure%n_dofs
         self%n_law = n_law
         self%n_harmonics = size(frequencies)
         self%coordinates = coordinates
         call new_condensation(condensation, structure, coordinates, loads, maxval([0.0_wp, abs(frequencies)]), wanted%loads, &
                               wanted%change)
         if (allocated(wanted%rates)) condensation%rates = wanted%rates
         if (structure%depends_on_tuple()) then
            self%tuples = tuples
            condensation%tuples = tuples
         end if
         self%interior = condensation%interior
         self%pattern = condensation%pattern
         allocate (self%load(n_law, self%n_harmonics), self%magnitude(n_law, self%n_harmonics))
         if (wanted%may_share .and. .not. wanted%is_on .and. condensation%can_share(self%n_harmonics)) then
            allocate (self%shared)
            call condensation%begin_shared(frequencies, self%shared)
         else
            allocate (self%condensed(self%pattern%n_rows, n_law, self%n_harmonics))
         end if
         if (wanted%of_interior) allocate (self%transfer(n_interior, n_law, self%n_harmonics))
         self%held_motion = loads
         self%held_motion%n_dofs = n_interior
         self%held_motion%values = loads%values(:n_interior, :)
         if (wanted%is_on) then
            allocate (self%condensed_slope, mold=self%condensed)
            allocate (self%load_slope, mold=self%load)
            if (.not. allocated(wanted%change)) then
               allocate (self%condensed_drive_slope, mold=self%condensed)
               allocate (self%load_drive_slope, mold=self%load)
            end if
            if (wanted%of_motion) allocate (self%motion_slope(n_interior, n_law + 1, 2, self%n_harmonics))
         end if
         call condense(self, condensation, frequencies, wanted%drives, error)
         if (allocated(error)) call name_empty_rows(structure, condensation%interior, error)
         if (condensation%drifting > 0) call fail(error, trim(drift_text("'"//trim(structure%labels(condensation%drifting))//"'")))
      end subroutine condense_with
   end subroutine condensed_to_coordinates

   !> Makes the stiffness of many contacts of a whole model, whose flexibility the caller keeps.
   subroutine new_contact_stiffness(self, flexibility, frequencies, loads, load_slopes)
      type(dynamic_stiffness_t), intent(out) :: self
      type(contact_flexibility_t), intent(in), target :: flexibility  !! with the modes for the highest frequency
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      type(amplitudes_t), intent(in), optional :: load_slopes         !! by the frequencies [N s], as in wanted_slopes_t

      self%n_dofs = flexibility%n_dofs
      self%n_law = flexibility%n
      self%n_harmonics = size(frequencies)
      self%coordinates = flexibility%coordinates
      call new_block_pattern(self%pattern, self%n_law, 0)
      allocate (self%contacts, self%free_dofs(0))
      call new_contact_response(self%contacts, flexibility, frequencies, loads, load_slopes)
      self%magnitude = spread(flexibility%contact, 2, self%n_harmonics)
      self%load = self%magnitude*self%contacts%stuck
   end subroutine new_contact_stiffness

   !> The same contacts at other frequencies or under other loads; fails where the modes cannot cover the frequencies.
   subroutine dynamic_stiffness_change_contacts(self, frequencies, loads, load_slopes, error)
      class(dynamic_stiffness_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      type(amplitudes_t), intent(in) :: loads, load_slopes            !! as for `new_contact_stiffness`
      type(error_t), allocatable, intent(out) :: error
      type(contact_response_t) :: changed
      logical :: is_covered

      associate (flexibility => self%contacts%flexibility)
         call flexibility%cover(maxval(abs(frequencies)), is_covered)
         if (.not. is_covered) then
            call fail(error, "the model has too many modes below "//to_text(maxval(abs(frequencies)))//" rad/s, the highest "// &
                      "frequency of the motion; lower the order, or reduce the model (nhbm-model reduce)")
            return
         end if
         call new_contact_response(changed, flexibility, frequencies, loads, load_slopes)
      end associate
      self%contacts = changed
      self%load = self%magnitude*self%contacts%stuck
   end subroutine dynamic_stiffness_change_contacts

   !> Entry (i, k) of S_c of harmonic h [N/m], which must be in its pattern.
   pure complex(wp) function dynamic_stiffness_entry(self, i, k, h) result(entry)
      class(dynamic_stiffness_t), intent(in) :: self
      integer, intent(in) :: i, k, h

      if (asserts_are_on) call assert(i >= self%pattern%first(k) .and. i <= self%pattern%last(k), &
                                      "dynamic_stiffness_entry", "an entry of the pattern")
      if (allocated(self%shared)) then
         entry = self%shared%entry(i, k, h)
      else if (allocated(self%contacts)) then
         entry = merge(self%magnitude(i, h), 0.0_wp, i == k)
      else
         entry = self%condensed(self%pattern%shift(k) + i, k, h)
      end if
   end function dynamic_stiffness_entry

   !> Successive columns of S_c of harmonic h [N/m] from number `first`, each from `pattern%first` to `pattern%last`; the rest of
   !> `columns` is unchanged.
   subroutine dynamic_stiffness_get_columns(self, first, h, columns)
      class(dynamic_stiffness_t), intent(in) :: self
      integer, intent(in) :: first, h
      complex(wp), intent(inout), contiguous :: columns(:, :)         !! (n_law, number of columns)
      integer :: i, k

      if (allocated(self%shared)) then
         call self%shared%get_columns(first, h, columns)
         return
      end if
      if (allocated(self%contacts)) then
         do i = 1, size(columns, 2)
            columns(first + i - 1, i) = self%entry(first + i - 1, first + i - 1, h)
         end do
         return
      end if
      do i = 1, size(columns, 2)
         k = first + i - 1
         associate (top => self%pattern%first(k), bottom => self%pattern%last(k), shift => self%pattern%shift(k))
            columns(top:bottom, i) = self%condensed(shift + top:shift + bottom, k, h)
         end associate
      end do
   end subroutine dynamic_stiffness_get_columns

   !> Largest magnitude of an entry of S_c [N/m]; of shared matrices, on the diagonal, where that of definite ones is.
   pure real(wp) function dynamic_stiffness_largest_entry(self) result(largest)
      class(dynamic_stiffness_t), intent(in) :: self
      integer :: h, k

      if (allocated(self%condensed)) then
         largest = maxval(abs(self%condensed))
         return
      end if
      largest = 0.0_wp
      do h = 1, self%n_harmonics
         do k = 1, self%n_law
            largest = max(largest, abs(self%entry(k, k, h)))
         end do
      end do
   end function dynamic_stiffness_largest_entry

   !> Condenses at other frequencies, reusing all data that do not depend on the frequency; only for a stiffness with
   !> slopes, or of contacts. Fails as `new_dynamic_stiffness` does.
   subroutine dynamic_stiffness_move(self, frequencies, drives, error)
      class(dynamic_stiffness_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics), of any sign
      real(wp), intent(in) :: drives(:)                               !! [rad**2/s**2], (n_harmonics)
      type(error_t), allocatable, intent(out) :: error
      class(condensation_t), allocatable :: condensation

      if (allocated(self%contacts)) then
         if (any(abs(drives) > 0.0_wp)) then
            call fail(error, "dynamic stiffness: contacts of a whole model have no artificial damping")
         else
            call self%change_contacts(frequencies, (self%contacts%loads), (self%contacts%load_slopes), error)
         end if
         return
      end if
      if (.not. allocated(self%condensation)) then
         call fail(error, "dynamic stiffness: created without slopes, it cannot be evaluated at other frequencies")
         return
      end if
      call move_alloc(self%condensation, condensation)
      call condense(self, condensation, frequencies, drives, error)
      call move_alloc(condensation, self%condensation)
   end subroutine dynamic_stiffness_move

   !> Moves all data to another object; this one is empty afterwards.
   subroutine dynamic_stiffness_transfer_to(self, to)
      class(dynamic_stiffness_t), intent(inout) :: self
      class(dynamic_stiffness_t), intent(inout) :: to

      to%n_dofs = self%n_dofs
      to%n_law = self%n_law
      to%n_harmonics = self%n_harmonics
      to%coordinates = self%coordinates
      to%pattern = self%pattern
      call move_alloc(self%condensed, to%condensed)
      call move_alloc(self%shared, to%shared)
      call move_alloc(self%contacts, to%contacts)
      call move_alloc(self%load, to%load)
      call move_alloc(self%magnitude, to%magnitude)
      call move_alloc(self%condensed_slope, to%condensed_slope)
      call move_alloc(self%load_slope, to%load_slope)
      call move_alloc(self%condensed_drive_slope, to%condensed_drive_slope)
      call move_alloc(self%load_drive_slope, to%load_drive_slope)
      call move_alloc(self%tuples, to%tuples)
      call move_alloc(self%interior, to%interior)
      call move_alloc(self%transfer, to%transfer)
      to%held_motion = self%held_motion
      call move_alloc(self%motion_slope, to%motion_slope)
      call move_alloc(self%free_dofs, to%free_dofs)
      call move_alloc(self%condensation, to%condensation)
   end subroutine dynamic_stiffness_transfer_to

   !> Copies the loads of some harmonics from a stiffness of only these, of the same structure, coordinates and
   !> frequencies; both without slopes.
   subroutine dynamic_stiffness_adopt_loads(self, part, positions)
      class(dynamic_stiffness_t), intent(inout) :: self
      type(dynamic_stiffness_t), intent(in) :: part
      integer, intent(in) :: positions(:)                             !! numbers of its harmonics here

      self%load(:, positions) = part%load
      call self%held_motion%replace(positions, part%held_motion)
   end subroutine dynamic_stiffness_adopt_loads

   !> The condensed part of some harmonics, without slopes and without the data for `recover`.
   function dynamic_stiffness_restricted_to(self, retained) result(part)
      class(dynamic_stiffness_t), intent(in) :: self
      integer, intent(in) :: retained(:)                              !! numbers of the harmonics
      type(dynamic_stiffness_t) :: part

      part%n_dofs = self%n_dofs
      part%n_law = self%n_law
      part%n_harmonics = size(retained)
      part%pattern = self%pattern
      part%coordinates = self%coordinates
      if (allocated(self%condensed)) part%condensed = self%condensed(:, :, retained)
      if (allocated(self%shared)) allocate (part%shared, source=self%shared%restricted_to(retained))
      if (allocated(self%contacts)) allocate (part%contacts, source=self%contacts%restricted_to(retained))
      part%load = self%load(:, retained)
      part%magnitude = self%magnitude(:, retained)
      if (allocated(self%tuples)) part%tuples = self%tuples(:, retained)
   end function dynamic_stiffness_restricted_to

   !> Condenses each harmonic, with slopes if there is memory for them.
   subroutine condense(self, condensation, frequencies, drives, error)
      class(dynamic_stiffness_t), intent(inout) :: self
      type(condensation_t), intent(inout) :: condensation
      real(wp), intent(in) :: frequencies(:), drives(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: h, i, k
      integer :: order(self%n_harmonics)
      logical :: is_singular

      call condensation%begin([(h, h=1, self%n_harmonics)], frequencies, drives, order)
      do i = 1, self%n_harmonics
         h = order(i)
         call condensation%eliminate(h, frequencies(h), drives(h), self%load(:, h), self%magnitude(:, h), is_singular)
         if (is_singular) then
            call fail(error, trim(singular_text(frequencies(h), self%n_law > 0)))
            if (condensation%drifting > 0) call fail(error, trim(drift_text(to_text(condensation%drifting))))
            exit
         end if
         if (allocated(self%shared)) then
            call condensation%add_to_shared(h, self%shared)
         else
            call condensation%get_block(frequencies(h), self%condensed(:, :, h))
         end if
         if (allocated(self%transfer)) self%transfer(:, :, h) = condensation%transfer
         k = findloc(self%held_motion%harmonics, h, dim=1)
         if (k > 0) self%held_motion%values(:, k) = condensation%held_motion
         if (allocated(self%condensed_slope)) then
            call condensation%find_slopes(h, frequencies(h), .false., self%condensed_slope(:, :, h), self%load_slope(:, h))
            if (allocated(self%motion_slope)) self%motion_slope(:, :, 1, h) = condensation%solver%rhs(:, :self%n_law + 1)
         end if
         if (allocated(self%condensed_drive_slope)) then
            call condensation%find_slopes(h, frequencies(h), .true., self%condensed_drive_slope(:, :, h), &
                                          self%load_drive_slope(:, h))
            if (allocated(self%motion_slope)) self%motion_slope(:, :, 2, h) = condensation%solver%rhs(:, :self%n_law + 1)
         end if
      end do
      call condensation%end()
      self%free_dofs = condensation%free_dofs()
   end subroutine condense

   !> Returns all degrees of freedom from the coordinates, x_r = y - T x_l.
   pure subroutine dynamic_stiffness_recover(self, law_coefficients, coefficients)
      class(dynamic_stiffness_t), intent(in) :: self
      complex(wp), intent(in) :: law_coefficients(:, :)               !! [m], (n_law, n_harmonics)
      complex(wp), intent(out) :: coefficients(:, :)                  !! [m], (n_dofs, n_harmonics)
      complex(wp) :: held(size(self%interior))
      integer :: h

      do h = 1, self%n_harmonics
         coefficients(self%coordinates%positions, h) = law_coefficients(:, h)
         if (size(held) == 0) cycle
         held = self%held_motion%of(h)
         coefficients(self%interior, h) = held - matmul(self%transfer(:, :, h), law_coefficients(:, h))
      end do
      call self%coordinates%motion_from(coefficients)
   end subroutine dynamic_stiffness_recover

   !> Whether the data for `recover` and `map_to_laws` exist.
   pure logical function dynamic_stiffness_has_interior(self) result(has_interior)
      class(dynamic_stiffness_t), intent(in) :: self

      has_interior = allocated(self%transfer) .or. allocated(self%contacts)
   end function dynamic_stiffness_has_interior

   !> Derivative of the motion of all degrees of freedom with respect to the frequency of each harmonic, and to its
   !> drive, at constant motion of the laws, dy - dT x_l; only for a stiffness with motion slopes.
   pure subroutine dynamic_stiffness_recover_slope(self, law_coefficients, by_drive, slope)
      class(dynamic_stiffness_t), intent(in) :: self
      complex(wp), intent(in) :: law_coefficients(:, :)               !! [m], (n_law, n_harmonics)
      logical, intent(in) :: by_drive
      complex(wp), intent(out) :: slope(:, :)                         !! [m s] or [m s**2], (n_dofs, n_harmonics)
      integer :: h

      slope(self%coordinates%positions, :) = (0.0_wp, 0.0_wp)
      do h = 1, self%n_harmonics
         associate (change => self%motion_slope(:, :, merge(2, 1, by_drive), h))
            slope(self%interior, h) = change(:, self%n_law + 1) - matmul(change(:, :self%n_law), law_coefficients(:, h))
         end associate
      end do
      call self%coordinates%motion_from(slope)
   end subroutine dynamic_stiffness_recover_slope

   !> Converts a gradient with respect to the motion of all degrees of freedom to one with respect to that of the
   !> laws, on which the others depend: g_l - T^H g_r, for functions with the differential Re(g^H dx).
   pure subroutine dynamic_stiffness_map_to_laws(self, gradient, law_gradient)
      class(dynamic_stiffness_t), intent(in) :: self
      complex(wp), intent(in) :: gradient(:, :)                       !! (n_dofs, n_harmonics)
      complex(wp), intent(out) :: law_gradient(:, :)                  !! (n_law, n_harmonics)
      complex(wp) :: g(self%n_dofs, self%n_harmonics)
      integer :: h

      g = self%coordinates%forces_in(gradient)
      do h = 1, self%n_harmonics
         law_gradient(:, h) = g(self%coordinates%positions, h) &
                              - matmul(transpose(conjg(self%transfer(:, :, h))), g(self%interior, h))
      end do
   end subroutine dynamic_stiffness_map_to_laws

   !> Solves S_c c = P_c: the motion of the law dofs without any law; of many contacts that in which they are stuck.
   !>
   !> If S_c is singular to rounding, as for a free structure at w = 0, that motion is not determined: the harmonic
   !> returns zero and is flagged.
   subroutine dynamic_stiffness_linear_amplitudes(self, c, is_singular)
      class(dynamic_stiffness_t), intent(in) :: self
      complex(wp), intent(out) :: c(:, :)                             !! [m], (n_law, n_harmonics)
      logical, intent(out) :: is_singular(:)                          !! (n_harmonics)
      complex(wp), allocatable :: a(:, :)                             ! in LAPACK's layout, a band with room for exchanges
      complex(wp) :: b(self%n_law, 2), columns(self%n_law, chunk_of_columns)
      real(wp) :: d(self%n_law), scale(self%n_law)
      real(wp) :: norm, reciprocal_condition, rounding
      integer :: above, first, h, i, k, n, pivots(self%n_law)

      n = self%n_law
      if (n == 1) then
         call linear_amplitudes_of_one(self, c(1, :), is_singular)
         return
      end if
      above = merge(self%pattern%half_bandwidth, 0, self%pattern%is_banded)
      allocate (a(self%pattern%n_rows + above, n))
      c = (0.0_wp, 0.0_wp)
      is_singular = .false.
      if (n == 0) return
      if (allocated(self%contacts)) then
         c = self%contacts%stuck
         return
      end if
      rounding = 100*real(self%n_dofs, wp)*epsilon(1.0_wp)
      do h = 1, self%n_harmonics
         ! Scaled by the cancelled terms of S_c, so that a remainder of rounding is recognised in any units.
         scale = 1.0_wp
         where (self%magnitude(:, h) > 0.0_wp) scale = 1.0_wp/sqrt(self%magnitude(:, h))
         a = (0.0_wp, 0.0_wp)
         do first = 1, n, chunk_of_columns
            call self%get_columns(first, h, columns(:, :min(chunk_of_columns, n - first + 1)))
            do k = first, min(first + chunk_of_columns - 1, n)
               do i = self%pattern%first(k), self%pattern%last(k)
                  a(above + self%pattern%shift(k) + i, k) = scale(i)*columns(i, k - first + 1)*scale(k)
               end do
            end do
         end do
         call balance_block(self%pattern, a, d)
         norm = max(1.0_wp, maxval(sum(abs(a), dim=1)))
         call factorise_block(self%pattern, a, pivots, is_singular(h))
         if (is_singular(h)) cycle
         b(:, 1) = scale/d*self%load(:, h)
         call solve_and_probe(self%pattern, a, pivots, norm, b, reciprocal_condition)
         is_singular(h) = reciprocal_condition < rounding
         if (.not. is_singular(h)) c(:, h) = scale*d*b(:, 1)
      end do
   end subroutine dynamic_stiffness_linear_amplitudes

   !> Divides rows by, and multiplies columns with, the factors that balance a block.
   subroutine balance_block(pattern, a, d)
      type(block_pattern_t), intent(in) :: pattern
      complex(wp), intent(inout), contiguous :: a(:, :)               !! in LAPACK's layout, with ones on the diagonal
      real(wp), intent(out) :: d(:)
      integer, allocatable :: column(:), row(:)
      real(wp), allocatable :: magnitude(:)
      integer :: i, k, offset(pattern%n)

      offset = merge(pattern%half_bandwidth, 0, pattern%is_banded) + pattern%shift
      row = [((i, i=pattern%first(k), pattern%last(k)), k=1, pattern%n)]
      column = [((k, i=pattern%first(k), pattern%last(k)), k=1, pattern%n)]
      magnitude = [((abs(a(offset(k) + i, k)), i=pattern%first(k), pattern%last(k)), k=1, pattern%n)]
      d = balancing_factors(pattern%n, row, column, magnitude)
      do k = 1, pattern%n
         do i = pattern%first(k), pattern%last(k)
            a(offset(k) + i, k) = a(offset(k) + i, k)*(d(k)/d(i))
         end do
      end do
   end subroutine balance_block

   !> Overwrites a block with its factors; `is_singular` if a pivot is zero.
   subroutine factorise_block(pattern, a, pivots, is_singular)
      type(block_pattern_t), intent(in) :: pattern
      complex(wp), intent(inout), contiguous :: a(:, :)
      integer, intent(out) :: pivots(:)
      logical, intent(out) :: is_singular
      integer :: info

      if (pattern%is_banded) then
         call factorise_band(a, pattern%half_bandwidth, pattern%half_bandwidth, pivots, is_singular)
      else
         call zgetrf(pattern%n, pattern%n, a, pattern%n, pivots, info)
         is_singular = info /= 0
      end if
   end subroutine factorise_block

   !> Solves for the first column, and measures the distance from a singular matrix as `block_solver_solve` does, by the growth of
   !> the second: the estimators of LAPACK take a time that is quadratic in the length of a chain.
   subroutine solve_and_probe(pattern, a, pivots, norm, b, reciprocal_condition)
      type(block_pattern_t), intent(in) :: pattern
      complex(wp), intent(in), contiguous :: a(:, :)                  !! factors
      integer, intent(in) :: pivots(:)
      real(wp), intent(in) :: norm                                    !! of the matrix
      complex(wp), intent(inout) :: b(:, :)                           !! (n, 2), the second column is overwritten
      real(wp), intent(out) :: reciprocal_condition
      real(wp) :: growth
      integer :: i

      b(:, 2) = probe_vector(pattern%n)
      growth = 1.0_wp/norm2(abs(b(:, 2)))
      call substitute_block(pattern, a, pivots, "N", b)
      growth = growth*norm2(abs(b(:, 2)))
      if (norm*growth > suspicious_growth) then
         do i = 1, 2
            b(:, 2) = b(:, 2)/cmplx(norm2(abs(b(:, 2))), kind=wp)
            call substitute_block(pattern, a, pivots, merge("C", "N", i == 1), b(:, 2:))
         end do
         growth = norm2(abs(b(:, 2)))
      end if
      reciprocal_condition = 1.0_wp/max(1.0_wp, norm*growth)
   end subroutine solve_and_probe

   !> Overwrites b with the solution of A X = b (`form` "N") or A**H X = b (`form` "C"), from the factors of A.
   subroutine substitute_block(pattern, a, pivots, form, b)
      type(block_pattern_t), intent(in) :: pattern
      complex(wp), intent(in), contiguous :: a(:, :)
      integer, intent(in) :: pivots(:)
      character, intent(in) :: form
      complex(wp), intent(inout), contiguous :: b(:, :)
      integer :: info

      if (pattern%is_banded) then
         call solve_band(form, a, pattern%half_bandwidth, pattern%half_bandwidth, pivots, b)
      else
         call zgetrs(form, pattern%n, size(b, 2), a, pattern%n, pivots, b, pattern%n, info)
      end if
   end subroutine substitute_block

   !> Linear motion of one degree of freedom by a division: LAPACK would take longer than the whole iteration of a
   !> small model.
   pure subroutine linear_amplitudes_of_one(self, c, is_singular)
      type(dynamic_stiffness_t), intent(in) :: self
      complex(wp), intent(out) :: c(:)                                !! [m], (n_harmonics)
      logical, intent(out) :: is_singular(:)                          !! (n_harmonics)
      real(wp) :: rounding, size_of_stiffness
      integer :: h

      rounding = 100*real(self%n_dofs, wp)*epsilon(1.0_wp)
      c = (0.0_wp, 0.0_wp)
      do h = 1, self%n_harmonics
         associate (stiffness => self%condensed(1, 1, h), magnitude => self%magnitude(1, h))
            size_of_stiffness = abs(stiffness)
            if (magnitude > 0.0_wp) size_of_stiffness = size_of_stiffness/magnitude
            is_singular(h) = size_of_stiffness < rounding
            if (.not. is_singular(h)) c(h) = self%load(1, h)/stiffness
         end associate
      end do
   end subroutine linear_amplitudes_of_one

   pure subroutine check_input(structure, law_dofs, frequencies, loads, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: law_dofs(:)
      real(wp), intent(in) :: frequencies(:)
      type(amplitudes_t), intent(in) :: loads
      type(error_t), allocatable, intent(out) :: error
      logical :: is_taken(structure%n_dofs)
      integer :: i

      is_taken = .false.
      do i = 1, size(law_dofs)
         if (law_dofs(i) < 1 .or. law_dofs(i) > structure%n_dofs) then
            call fail(error, "dynamic stiffness: a law acts on degree of freedom "//to_text(law_dofs(i))// &
                      ", the structure has 1 to "//to_text(structure%n_dofs))
            return
         else if (is_taken(law_dofs(i))) then
            call fail(error, "dynamic stiffness: degree of freedom "//trim(structure%labels(law_dofs(i)))// &
                      " occurs twice among those of the laws")
            return
         end if
         is_taken(law_dofs(i)) = .true.
      end do
      if (.not. all(ieee_is_finite(frequencies))) then
         call fail(error, "dynamic stiffness: a frequency is not a finite number")
      else if (loads%n_dofs /= structure%n_dofs .or. loads%n_harmonics /= size(frequencies)) then
         call fail(error, "dynamic stiffness: loads are "//to_text(loads%n_dofs)//" x "// &
                   to_text(loads%n_harmonics)// &
                   ", degrees of freedom x frequencies are "// &
                   to_text(structure%n_dofs)//" x "//to_text(size(frequencies)))
      else if (.not. all(ieee_is_finite(real(loads%values)) .and. ieee_is_finite(aimag(loads%values)))) then
         call fail(error, "dynamic stiffness: a load is not a finite number")
      end if
   end subroutine check_input

   !> Reason why the interior is singular at this harmonic, and a remedy.
   pure function drift_text(dof) result(text)
      character(*), intent(in) :: dof
      character(300) :: text

      text = "degree of freedom "//dof//" has no static stiffness and drifts under the static load: no motion has a mean value "// &
             "there; add a support, or remove the load of the zero tuple"
   end function drift_text

   !> Replaces the reason why the interior is singular where rows of it are empty, as those of constrained nodes in files of other
   !> programs: no force acts on them in a motion of all coordinates.
   subroutine name_empty_rows(structure, interior, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: interior(:)
      type(error_t), allocatable, intent(inout) :: error
      real(wp), parameter :: golden_ratio = 0.6180339887498949_wp     ! multiples of it are spread without a pattern
      complex(wp), dimension(structure%n_dofs) :: at_rest, in_motion, motion
      integer, allocatable :: empty(:)
      integer :: i

      motion = [(cmplx(1.0_wp + modulo(i*golden_ratio, 1.0_wp), kind=wp), i=1, structure%n_dofs)]
      at_rest = structure%force_in(motion, 0.0_wp, 0.0_wp)
      in_motion = structure%force_in(motion, 1.0_wp, 0.0_wp)          ! alone it vanishes at a natural frequency of 1 rad/s
      empty = pack(interior, .not. abs(at_rest(interior)) + abs(in_motion(interior)) > 0.0_wp)
      if (size(empty) == 0) return
      call fail(error, "dynamic stiffness: singular: degree of freedom '"//trim(structure%labels(empty(1)))//"', the first of "// &
                to_text(size(empty))//", has neither mass nor stiffness, as constrained rows that files of other "// &
                "programs keep and nodes without elements; leave them out (nhbm-model import --drop-empty)")
   end subroutine name_empty_rows

   pure function singular_text(frequency, has_law_dofs) result(text)
      real(wp), intent(in) :: frequency
      logical, intent(in) :: has_law_dofs
      character(300) :: text
      character(:), allocatable :: held

      held = ""
      if (has_law_dofs) held = " with the degrees of freedom of its laws held fixed"
      text = "dynamic stiffness: singular at the frequency "//to_text(frequency)//" rad/s:"
      if (abs(frequency) > 0.0_wp) then
         text = trim(text)//" an undamped resonance of the structure"//held//"; add damping or change the frequency"
      else
         text = trim(text)//" the structure"//held//" can move as a rigid body; add a support or stiffness"
      end if
   end function singular_text
end module hb_dynamic_stiffness
