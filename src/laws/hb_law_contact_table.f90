!> Many contacts by linear functionals: gap g_i = g0_i + a_i.q, contact force l_i = k_i max(0, -g_i), friction mu_i
!> l_i.
!>
!> The force on the structure is l_i a_i, which opens the gap, and mu_i l_i b_i with b_i the row of `friction_shapes`;
!> the law is the negative: f = - sum over i of l_i (a_i + mu_i b_i). Blade i of a disk against a casing is one row:
!> a_i contains the negative radial shape of the disk and the radial shape of the casing at the blade, b_i the
!> tangential shapes likewise. The direction of friction is fixed.
!>
!> Coordinates that come in pairs may belong to a frame that rotates relative to the contacts: at the phase tau of a
!> tone the entries of a pair in all a_i and b_i are rotated by the angle n tau. Blades that move along a casing are
!> such contacts: for a mode of n diameters, cos n(phi_i + tau) and sin n(phi_i + tau) are the rotated cos n phi_i and
!> sin n phi_i.
!>
!> Contacts that act on two independent combinations of the coordinates may be rigid instead: see hb_rigid_contacts.
!> Source: docs/why/theory.md, sections 5.2 and 5.3. Sign: f stands beside K q on the left-hand side.
module hb_law_contact_table
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_kinds, only: wp
   use hb_law, only: defects_t, hold_t, kink_t, law_t, placement_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   use hb_rigid_contacts, only: new_rigid_contacts, rigid_contacts_t
   use hb_text, only: to_text
   implicit none
   private
   public :: check_contacts, check_length, complete_contacts, contact_table_t, declare_contacts, has_lengths
   public :: new_contact_table, one_for_each, set_turns

   integer, parameter :: block_size = 256                             ! samples that remain in the cache over all contacts

   type, extends(law_t) :: contact_table_t
      integer :: n_contacts = 0
      real(wp), allocatable :: shapes(:, :)                           !! a_i, (n_contacts, n_dofs)
      real(wp), allocatable :: given_gaps(:)                          !! g0_i [m]; one for all contacts, or (n_contacts)
      real(wp), allocatable :: given_stiffness(:)                     !! k_i [N/m], likewise
      real(wp), allocatable :: given_friction(:)                      !! mu_i, likewise
      real(wp), allocatable :: friction_shapes(:, :)                  !! b_i, (n_contacts, n_dofs)
      logical :: is_rigid = .false.
      real(wp) :: augmentation = 0.0_wp                               !! eps of rigid contacts [N/m], 0: from the structure
      real(wp), allocatable :: pushes(:, :)                           !! a_i + mu_i b_i, (n_contacts, n_dofs)
      real(wp), allocatable :: gaps(:)                                !! g0_i [m], (n_contacts); negative: preloaded at rest
      real(wp), allocatable :: stiffness(:)                           !! k_i [N/m], (n_contacts); 0 if rigid
      type(rigid_contacts_t), allocatable :: rigid                    !! if rigid
      character(:), allocatable :: failure                            !! why contacts cannot be rigid; not allocated if they can
      integer, allocatable :: turns(:)                                !! n of each pair of coordinates; not allocated: none rotates
      real(wp), allocatable, private :: cosine(:, :), sine(:, :)      ! of n tau, (n_samples, n_pairs)
   contains
      procedure :: declare_numbers => contact_table_declare_numbers
      procedure :: placement => contact_table_placement
      procedure :: has_valid_numbers => contact_table_has_valid_numbers
      procedure :: check => contact_table_check
      procedure :: derive => contact_table_derive
      procedure :: number_slope => contact_table_number_slope
      procedure :: set_phases => contact_table_set_phases
      procedure :: evaluate => contact_table_evaluate
      procedure :: potential => contact_table_potential
      procedure :: prepare => contact_table_prepare
      procedure :: prepare_rate => contact_table_prepare_rate
      procedure :: correct => contact_table_correct
      procedure :: defects => contact_table_defects
      procedure :: hold => contact_table_hold
      procedure :: switches => contact_table_switches
      procedure :: evaluate_held => contact_table_evaluate_held
   end type contact_table_t

contains

   !> Creates a table of contacts; without friction `friction` is zero and `friction_shapes` arbitrary.
   pure subroutine new_contact_table(self, shapes, gaps, stiffness, friction, friction_shapes)
      class(contact_table_t), intent(inout) :: self
      real(wp), intent(in) :: shapes(:, :)                            !! a_i, (n_contacts, n_dofs)
      real(wp), intent(in) :: gaps(:)                                 !! [m], (n_contacts)
      real(wp), intent(in) :: stiffness(:)                            !! [N/m], (n_contacts), >= 0
      real(wp), intent(in) :: friction(:)                             !! mu_i, (n_contacts)
      real(wp), intent(in) :: friction_shapes(:, :)                   !! b_i, as shapes

      self%n_contacts = size(gaps)
      self%shapes = shapes
      self%given_gaps = gaps
      self%given_stiffness = stiffness
      self%given_friction = friction
      self%friction_shapes = friction_shapes
      call complete_contacts(self)
   end subroutine new_contact_table

   subroutine contact_table_declare_numbers(self, numbers)
      class(contact_table_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("n_contacts", self%n_contacts)
      call declare_contacts(self, numbers)
      if (allocated(self%given_gaps) .and. allocated(self%given_stiffness) .and. allocated(self%dofs) .and. &
          self%n_contacts > 0) then
         associate (n => self%n_contacts, m => size(self%dofs))
            call numbers%add("shapes", self%shapes, n, m)
            if (.not. allocated(self%friction_shapes)) allocate (self%friction_shapes(n, m), source=0.0_wp)
            call numbers%add("friction_shapes", self%friction_shapes, n, m, required=any(self%given_friction > 0.0_wp))
         end associate
      end if
      call numbers%add("tone", self%n_phases)
      if (self%n_phases > 0) call numbers%add("turns", self%turns)
   end subroutine contact_table_declare_numbers

   !> Declares whether contacts are rigid, and their numbers other than shapes.
   subroutine declare_contacts(self, numbers)
      class(contact_table_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("contact", self%is_rigid, word="rigid")
      call numbers%add("gaps", self%given_gaps)
      if (self%is_rigid) then
         call numbers%reject("stiffness", "rigid contacts have none: remove it, or use contact = 'elastic'")
         self%given_stiffness = [0.0_wp]
         call numbers%add("augmentation", self%augmentation)
      else
         call numbers%reject("augmentation", "only rigid contacts have one: remove it, or use contact = 'rigid'")
         call numbers%add("stiffness", self%given_stiffness)
      end if
      call numbers%add("friction_coefficient", self%given_friction)
   end subroutine declare_contacts

   logical function contact_table_has_valid_numbers(self) result(are_valid)
      class(contact_table_t), intent(in) :: self

      are_valid = allocated(self%shapes) .and. has_lengths(self) .and. .not. allocated(self%failure)
      if (.not. are_valid) return
      are_valid = all(norm2(self%shapes, dim=2) > 0.0_wp)
      if (are_valid .and. any(self%given_friction > 0.0_wp)) are_valid = any(abs(self%friction_shapes) > 0.0_wp)
   end function contact_table_has_valid_numbers

   !> Whether the lists have one number, or one for each contact.
   pure logical function has_lengths(self)
      class(contact_table_t), intent(in) :: self

      has_lengths = allocated(self%given_gaps) .and. allocated(self%given_stiffness) .and. allocated(self%given_friction)
      if (has_lengths) has_lengths = is_fine(self%given_gaps) .and. is_fine(self%given_stiffness) .and. is_fine(self%given_friction)

   contains

      pure logical function is_fine(values)
         real(wp), intent(in) :: values(:)

         is_fine = size(values) == 1 .or. size(values) == self%n_contacts
      end function is_fine
   end function has_lengths

   subroutine contact_table_check(self, problems)
      class(contact_table_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems
      integer :: i

      call check_contacts(self, problems)
      if (.not. allocated(self%shapes)) return
      do i = 1, size(self%shapes, 1)
         if (all(self%shapes(i, :) == 0.0_wp)) call problems%add("shapes", "row "//to_text(i)//" is zero: its gap never moves")
      end do
      if (.not. allocated(self%turns)) return
      if (2*size(self%turns) /= size(self%shapes, 2)) &
         call problems%add("turns", "give one number for each pair of 'dofs', that is half as many")
   end subroutine contact_table_check

   !> Reports lists that have neither one number nor one for each contact, and contacts that cannot be rigid.
   subroutine check_contacts(self, problems)
      class(contact_table_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. (allocated(self%given_gaps) .and. allocated(self%given_stiffness) .and. allocated(self%given_friction))) return
      if (self%n_contacts < 1) return
      call check_length("gaps", self%given_gaps, self%n_contacts, problems)
      call check_length("stiffness", self%given_stiffness, self%n_contacts, problems)
      call check_length("friction_coefficient", self%given_friction, self%n_contacts, problems)
      if (allocated(self%failure)) call problems%add("contact", self%failure)
   end subroutine check_contacts

   !> Reports a list that has neither one number nor one for each contact.
   subroutine check_length(key, values, n, problems)
      character(*), intent(in) :: key
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n                                        !! contacts
      class(problems_t), intent(inout) :: problems

      if (all(size(values) /= [1, n])) call problems%add(key, "give one number, or one for each of the "//to_text(n)//" contacts")
   end subroutine check_length

   pure function contact_table_placement(self) result(placement)
      class(contact_table_t), intent(in) :: self
      type(placement_t) :: placement

      placement%is_by_dofs = .true.
   end function contact_table_placement

   pure subroutine contact_table_derive(self)
      class(contact_table_t), intent(inout) :: self

      self%has_potential = .true.                                     ! until determined
      if (has_lengths(self) .and. allocated(self%shapes)) call complete_contacts(self)
   end subroutine contact_table_derive

   !> Computes what follows from the shapes and the other numbers of contacts.
   pure subroutine complete_contacts(self)
      class(contact_table_t), intent(inout) :: self
      real(wp) :: friction(self%n_contacts)
      character(:), allocatable :: failure
      integer :: i

      self%gaps = one_for_each(self%given_gaps, self%n_contacts)
      self%stiffness = one_for_each(self%given_stiffness, self%n_contacts)
      friction = one_for_each(self%given_friction, self%n_contacts)
      associate (shapes => self%shapes, gaps => self%gaps, stiffness => self%stiffness)
         self%pushes = shapes + spread(friction, 2, size(shapes, 2))*self%friction_shapes
         self%has_potential = all(abs(self%pushes - shapes) <= 0.0_wp)
         self%has_convex_free_region = .true.
         self%length_scale = maxval(abs(gaps))
         self%n_switches = size(gaps)
         if (allocated(self%kinks)) deallocate (self%kinks)
         allocate (self%kinks(size(gaps)))             ! no array constructor: as in set_kinks_of_coordinate
         do i = 1, size(gaps)
            self%kinks(i) = kink_t(-shapes(i, :), -self%pushes(i, :), [gaps(i)], [stiffness(i)])
         end do
      end associate
      if (self%is_rigid .and. all(norm2(self%shapes, dim=2) > 0.0_wp)) then
         if (.not. allocated(self%rigid)) allocate (self%rigid)
         call new_rigid_contacts(self%rigid, self%shapes, self%pushes, self%gaps, self%augmentation, failure)
         self%is_multiplier = .true.
         if (allocated(self%failure)) deallocate (self%failure)
         if (len(failure) > 0) self%failure = failure
      end if
      if (allocated(self%turns)) call forget_fixed_contacts(self)
   end subroutine complete_contacts

   !> Discards what only contacts have that do not rotate: they move past the coordinates.
   pure subroutine forget_fixed_contacts(self)
      class(contact_table_t), intent(inout) :: self

      self%has_potential = .false.
      if (allocated(self%kinks)) deallocate (self%kinks)              ! their positions are not those of any coordinate
   end subroutine forget_fixed_contacts

   !> Makes pairs of coordinates (1 and 2, 3 and 4, ...) rotate with the phase of a tone.
   pure subroutine set_turns(self, tone, turns)
      class(contact_table_t), intent(inout) :: self
      integer, intent(in) :: tone
      integer, intent(in) :: turns(:)                                 !! n of each pair, 0 for one that does not rotate

      self%n_phases = tone
      self%turns = turns
      call forget_fixed_contacts(self)
   end subroutine set_turns

   !> Sets the phase of the tone with which the contacts rotate.
   pure subroutine contact_table_set_phases(self, phases)
      class(contact_table_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)
      real(wp) :: phase(size(phases, 2))
      integer :: k

      phase = phases(self%n_phases, :)
      if (allocated(self%cosine)) then
         if (size(self%cosine, 1) /= size(phase)) deallocate (self%cosine, self%sine)
      end if
      if (.not. allocated(self%cosine)) &
         allocate (self%cosine(size(phase), size(self%turns)), self%sine(size(phase), size(self%turns)))
      do k = 1, size(self%turns)
         self%cosine(:, k) = cos(self%turns(k)*phase)
         self%sine(:, k) = sin(self%turns(k)*phase)
      end do
   end subroutine contact_table_set_phases

   !> One number for each contact.
   pure function one_for_each(given, n) result(values)
      real(wp), intent(in) :: given(:)                                !! one for all, or (n)
      integer, intent(in) :: n
      real(wp) :: values(n)

      if (size(given) == 1) then
         values = given(1)
      else
         values = given
      end if
   end function one_for_each

   subroutine contact_table_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      logical :: is_reported

      if (.not. allocated(self%turns)) then ! absent derivatives are not passed on, which sanitizers would report
         if (present(df_dz)) then
            call push_back(self, z, p, f, df_dz, df_dp)
         else
            call push_back(self, z, p, f)
         end if
         return
      end if
      is_reported = allocated(self%cosine)
      if (is_reported) is_reported = size(self%cosine, 1) == size(z, 1)
      if (.not. is_reported) then                                     ! without phases of these samples the force is undefined
         f = ieee_value(1.0_wp, ieee_quiet_nan)
         if (present(df_dz)) df_dz = f(1, 1)
         if (present(df_dp)) df_dp = f(1, 1)
         return
      end if
      if (present(df_dz)) then
         call push_back(self, seen(self, z), seen(self, p), f, df_dz, df_dp)
         call turn_slopes(self, df_dz)
         call turn_slopes(self, df_dp)
      else
         call push_back(self, seen(self, z), seen(self, p), f)
      end if
      call turn(self, f, 1.0_wp)
   end subroutine contact_table_evaluate

   !> Forces of the table without rotation, elastic or rigid.
   subroutine push_back(self, z, p, f, df_dz, df_dp)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dp(:, :, :)

      if (allocated(self%rigid) .and. present(df_dz)) then
         call self%rigid%evaluate(z, p, f, df_dz, df_dp)
      else if (allocated(self%rigid)) then
         call self%rigid%evaluate(z, p, f)
      else if (present(df_dz)) then
         call press(self, z, f, df_dz)
      else
         call press(self, z, f)
      end if
   end subroutine push_back

   !> Samples of coordinates or reactions in the frame of the contacts: (R a).z = a.(R^T z).
   pure function seen(self, columns)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in) :: columns(:, :)                           !! (n_samples, n_coordinates), or no columns
      real(wp), allocatable :: seen(:, :)

      seen = columns
      if (allocated(self%turns) .and. size(seen, 2) > 0) call turn(self, seen, -1.0_wp)
   end function seen

   !> Rotates derivatives of forces by coordinates or reactions, R (df/dz) R^T.
   pure subroutine turn_slopes(self, slopes)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(inout) :: slopes(:, :, :)                      !! (n_samples, n_coordinates, n_coordinates or 0)
      integer :: k

      do k = 1, size(slopes, 3)
         call turn(self, slopes(:, :, k), 1.0_wp)
      end do
      if (size(slopes, 3) == 0) return
      do k = 1, size(slopes, 2)
         call turn(self, slopes(:, k, :), 1.0_wp)
      end do
   end subroutine turn_slopes

   !> Rotates each pair of columns by the angle n tau of its sample, forwards (`sense` 1) or backwards (-1).
   pure subroutine turn(self, columns, sense)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(inout) :: columns(:, :)                        !! (n_samples, n_coordinates)
      real(wp), intent(in) :: sense
      real(wp) :: first(size(columns, 1))
      integer :: k

      do k = 1, size(self%turns)
         if (self%turns(k) == 0) cycle
         associate (x => columns(:, 2*k - 1), y => columns(:, 2*k), c => self%cosine(:, k), s => sense*self%sine(:, k))
            first = c*x - s*y
            y = s*x + c*y
            x = first
         end associate
      end do
   end subroutine turn

   !> Forces of elastic contacts.
   subroutine press(self, z, f, df_dz)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :)
      real(wp) :: gap(block_size), load(block_size)
      integer :: a, b, first, i, last, n

      f = 0.0_wp
      if (present(df_dz)) df_dz = 0.0_wp
      do first = 1, size(z, 1), block_size
         last = min(first + block_size - 1, size(z, 1))
         n = last - first + 1
         do i = 1, size(self%gaps)
            gap(1:n) = self%gaps(i)
            do a = 1, size(z, 2)
               gap(1:n) = gap(1:n) + self%shapes(i, a)*z(first:last, a)
            end do
            if (all(gap(1:n) >= 0.0_wp)) cycle
            load(1:n) = self%stiffness(i)*max(-gap(1:n), 0.0_wp)
            do a = 1, size(z, 2)
               f(first:last, a) = f(first:last, a) - self%pushes(i, a)*load(1:n)
            end do
            if (.not. present(df_dz)) cycle
            load(1:n) = merge(self%stiffness(i), 0.0_wp, gap(1:n) < 0.0_wp)
            do b = 1, size(z, 2)
               do a = 1, size(z, 2)
                  df_dz(first:last, a, b) = df_dz(first:last, a, b) + self%pushes(i, a)*self%shapes(i, b)*load(1:n)
               end do
            end do
         end do
      end do
   end subroutine press

   !> Of elastic contacts by all numbers but the shapes.
   subroutine contact_table_number_slope(self, number, z, v, p, slope, is_known)
      class(contact_table_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: by_number(size(z, 2)), gap(size(z, 1)), place(size(z, 1), size(z, 2))
      integer :: a, first, i, last

      slope = 0.0_wp
      is_known = .not. self%is_rigid .and. any(number%key == [character(20) :: "gaps", "stiffness", "friction_coefficient"])
      if (is_known .and. allocated(self%turns)) is_known = allocated(self%cosine)
      if (.not. is_known) return
      place = seen(self, z)
      first = max(1, number%element(1))
      last = first
      if (number%element(1) == 0 .or. n_given() == 1) last = self%n_contacts   ! one number for all
      do i = first, last
         gap = self%gaps(i) + matmul(place, self%shapes(i, :))
         select case (number%key)
         case ("gaps")
            by_number = self%pushes(i, :)*self%stiffness(i)
            gap = merge(1.0_wp, 0.0_wp, gap < 0.0_wp)
         case ("stiffness")
            by_number = -self%pushes(i, :)
            gap = max(-gap, 0.0_wp)
         case default
            by_number = -self%friction_shapes(i, :)*self%stiffness(i)
            gap = max(-gap, 0.0_wp)
         end select
         do a = 1, size(z, 2)
            slope(:, a) = slope(:, a) + by_number(a)*gap
         end do
      end do
      if (allocated(self%turns)) call turn(self, slope, 1.0_wp)

   contains

      integer function n_given()
         select case (number%key)
         case ("gaps"); n_given = size(self%given_gaps)
         case ("stiffness"); n_given = size(self%given_stiffness)
         case default; n_given = size(self%given_friction)
         end select
      end function n_given
   end subroutine contact_table_number_slope

   !> Sets eps of rigid contacts to the static stiffness of the structure unless given by the user, for a model
   !> without motion.
   subroutine contact_table_prepare(self, static_stiffness)
      class(contact_table_t), intent(inout) :: self
      real(wp), intent(in) :: static_stiffness

      if (allocated(self%rigid)) call self%rigid%propose(static_stiffness)
   end subroutine contact_table_prepare

   !> Sets eps of rigid contacts to the dynamic stiffness of the structure in the fastest harmonic unless given by the
   !> user, because load passes from one contact to the next at that rate.
   subroutine contact_table_prepare_rate(self, impedance, frequency)
      class(contact_table_t), intent(inout) :: self
      real(wp), intent(in) :: impedance, frequency

      if (allocated(self%rigid)) call self%rigid%propose(impedance*frequency)
   end subroutine contact_table_prepare_rate

   !> Moves points behind rigid contacts onto them, with the phases set last.
   pure subroutine contact_table_correct(self, z, corrected)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :)
      real(wp), intent(out) :: corrected(:, :)

      corrected = z
      if (.not. allocated(self%rigid)) return
      call self%rigid%correct(seen(self, z), corrected)
      if (allocated(self%turns)) call turn(self, corrected, 1.0_wp)
   end subroutine contact_table_correct

   pure function contact_table_defects(self, z, v, p) result(defects)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :), p(:, :)
      type(defects_t) :: defects

      if (allocated(self%rigid)) defects = self%rigid%defects(seen(self, z), seen(self, p))
   end function contact_table_defects

   pure subroutine contact_table_switches(self, z, v, values)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)
      real(wp) :: seen_z(size(z))

      seen_z = seen_by_contacts(self, z)
      values = -self%gaps - matmul(self%shapes, seen_z)
   end subroutine contact_table_switches

   subroutine contact_table_evaluate_held(self, z, v, is_positive, f)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)
      real(wp) :: forces(1, size(z)), turned(size(z))
      integer :: i

      turned = seen_by_contacts(self, z)
      f = 0.0_wp
      do i = 1, size(self%gaps)
         if (.not. is_positive(i)) cycle
         f = f + self%pushes(i, :)*self%stiffness(i)*(self%gaps(i) + dot_product(self%shapes(i, :), turned))
      end do
      if (.not. allocated(self%turns)) return
      forces(1, :) = f
      call turn(self, forces, 1.0_wp)
      f = forces(1, :)
   end subroutine contact_table_evaluate_held

   !> Coordinates at one moment in the frame of the contacts, whose phase must have been set.
   pure function seen_by_contacts(self, z) result(seen)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in) :: z(:)                                    !! [m], (n_coordinates)
      real(wp) :: seen(size(z)), turned(1, size(z))

      seen = z
      if (.not. allocated(self%turns)) return
      turned(1, :) = z
      call turn(self, turned, -1.0_wp)
      seen = turned(1, :)
   end function seen_by_contacts

   !> Rigid contacts are several constraints on the same coordinates.
   function contact_table_hold(self) result(hold)
      class(contact_table_t), intent(in) :: self
      type(hold_t) :: hold

      hold%failure = "no method of time integration supports rigid contacts of a table or of blades: "// &
                       "for time integration give law '"// &
                     self%label//"' contact = 'elastic' and a large stiffness"
   end function contact_table_hold

   !> Sum of k_i min(g_i, 0)**2/2, without friction.
   subroutine contact_table_potential(self, z, energy, gradient)
      class(contact_table_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: pressed(size(z, 1))
      integer :: a, i

      energy = 0.0_wp
      gradient = 0.0_wp
      do i = 1, size(self%gaps)
         pressed = min(self%gaps(i) + matmul(z, self%shapes(i, :)), 0.0_wp)
         energy = energy + 0.5_wp*self%stiffness(i)*pressed**2
         do a = 1, size(z, 2)
            gradient(:, a) = gradient(:, a) + self%stiffness(i)*self%shapes(i, a)*pressed
         end do
      end do
   end subroutine contact_table_potential
end module hb_law_contact_table
