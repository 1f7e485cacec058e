!> Blades of a disk against a casing, both moving in two modes of n nodal diameters: a contact table generated from
!> angles.
!>
!> Coordinates: q1, q2 of the disk, r1, r2 of the casing, u = q1 cos(n phi) + q2 sin(n phi). Blade i of N is at phi_i
!> = 2 pi i/N and moves s_i times as far as the mode. Gap g_i = g0_i + u_c(phi_i) - s_i u_d(phi_i), contact force l_i
!> = k_i max(0, -g_i), friction mu_i l_i against the rotation of the disk with the arms eta_d of the disk and eta_c of
!> the casing: with e = (cos(n phi_i), sin(n phi_i)) and e' = (-sin(n phi_i), cos(n phi_i)) the force on the disk is
!> -l_i s_i (e + mu_i eta_d e'), that on the casing l_i (e + mu_i eta_c e'). If the coordinates of a body belong to
!> the stationary frame, the blades rotate relative to them with the phase of the tone that is the speed of the rotor.
!> Blades may be rigid (see hb_rigid_contacts) if all have the same share. Source: docs/why/theory.md, sections 5.2
!> and 5.3. Sign: f stands beside K q on the left-hand side.
module hb_law_blade_contact
   use hb_kinds, only: int64, two_pi, wp
   use hb_law, only: placement_t
   use hb_law_contact_table, only: check_contacts, check_length, complete_contacts, contact_table_t, declare_contacts, &
      has_lengths, one_for_each, set_turns
   use hb_numbers, only: numbers_t
   use hb_problems, only: problems_t
   implicit none
   private
   public :: blade_contact_t, new_blade_contact

   type, extends(contact_table_t) :: blade_contact_t
      integer :: n_diameters = 0
      real(wp), allocatable :: arms(:)                                !! eta_d, eta_c
      real(wp), allocatable :: given_shares(:)                        !! s_i; one for all blades, or (n_contacts)
      logical :: is_rotating = .true.                                 !! both bodies belong to the frame of the blades
      logical :: is_stationary = .false.                              !! both belong to the stationary frame; or each to its own
   contains
      procedure :: declare_numbers => blade_contact_declare_numbers
      procedure :: placement => blade_contact_placement
      procedure :: has_valid_numbers => blade_contact_has_valid_numbers
      procedure :: check => blade_contact_check
      procedure :: derive => blade_contact_derive
   end type blade_contact_t

contains

   !> Contacts of size(gaps) equally spaced blades, which may differ in gap, stiffness, friction and share.
   pure subroutine new_blade_contact(self, n_diameters, gaps, stiffness, friction, arms, shares)
      class(blade_contact_t), intent(inout) :: self
      integer, intent(in) :: n_diameters
      real(wp), intent(in) :: gaps(:)                                 !! g0_i [m], (n_blades)
      real(wp), intent(in) :: stiffness(:)                            !! k_i [N/m], (n_blades), >= 0
      real(wp), intent(in) :: friction(:)                             !! mu_i, (n_blades)
      real(wp), intent(in) :: arms(2)                                 !! eta_d, eta_c
      real(wp), intent(in) :: shares(:)                               !! s_i, (n_blades)

      self%n_diameters = n_diameters
      self%n_contacts = size(gaps)
      self%given_gaps = gaps
      self%given_stiffness = stiffness
      self%given_friction = friction
      self%arms = arms
      self%given_shares = shares
      call self%derive()
   end subroutine new_blade_contact

   subroutine blade_contact_declare_numbers(self, numbers)
      class(blade_contact_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("n_diameters", self%n_diameters)
      call numbers%add("n_blades", self%n_contacts)
      call declare_contacts(self, numbers)
      call numbers%add("shares", self%given_shares)
      if (.not. allocated(self%arms)) self%arms = [0.0_wp, 0.0_wp]
      call numbers%add("friction_arms", self%arms, n=2, required=any(self%given_friction > 0.0_wp))
      call numbers%add("frame", self%is_rotating, word="rotating")
      call numbers%add("frame", self%is_stationary, word="stationary")
      if (.not. self%is_rotating) call numbers%add("tone", self%n_phases)
   end subroutine blade_contact_declare_numbers

   logical function blade_contact_has_valid_numbers(self) result(are_valid)
      class(blade_contact_t), intent(in) :: self

      are_valid = size(self%given_shares) == 1 .or. size(self%given_shares) == self%n_contacts
      if (are_valid .and. any(self%given_friction > 0.0_wp)) are_valid = any(abs(self%arms) > 0.0_wp)
      if (are_valid) are_valid = .not. allocated(self%failure)
   end function blade_contact_has_valid_numbers

   !> Whether the numbers have their lengths.
   pure logical function is_complete(self)
      class(blade_contact_t), intent(in) :: self

      is_complete = has_lengths(self) .and. allocated(self%given_shares) .and. allocated(self%arms)
      is_complete = is_complete .and. self%n_contacts > 0 .and. self%n_diameters > 0
      if (is_complete) is_complete = any(size(self%given_shares) == [1, self%n_contacts]) .and. size(self%arms) == 2
   end function is_complete

   subroutine blade_contact_check(self, problems)
      class(blade_contact_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      call check_contacts(self, problems)
      if (allocated(self%given_shares) .and. self%n_contacts > 0) &
         call check_length("shares", self%given_shares, self%n_contacts, problems)
   end subroutine blade_contact_check

   pure function blade_contact_placement(self) result(placement)
      class(blade_contact_t), intent(in) :: self
      type(placement_t) :: placement

      placement%is_by_dofs = .true.
      placement%counts = 4
      placement%dofs = "name both coordinates of the disk, then both of the casing"
   end function blade_contact_placement

   pure subroutine blade_contact_derive(self)
      class(blade_contact_t), intent(inout) :: self
      real(wp), dimension(self%n_contacts) :: angle, shares
      integer :: i

      self%has_potential = .true.                                     ! until determined
      if (.not. is_complete(self)) return
      if (allocated(self%shapes)) then
         if (size(self%shapes, 1) /= self%n_contacts) deallocate (self%shapes, self%friction_shapes)
      end if
      if (.not. allocated(self%shapes)) allocate (self%shapes(self%n_contacts, 4), self%friction_shapes(self%n_contacts, 4))
      ! The remainder limits the angle, so that blades half a wave apart get the same digits.
      associate (n => self%n_contacts)
         angle = [(two_pi*real(modulo(int(self%n_diameters, int64)*i, int(n, int64)), wp)/real(n, wp), i=1, n)]
         shares = one_for_each(self%given_shares, n)
      end associate
      associate (shapes => self%shapes, friction_shapes => self%friction_shapes, arms => self%arms)
         shapes(:, 1) = -shares*cos(angle)
         shapes(:, 2) = -shares*sin(angle)
         shapes(:, 3) = cos(angle)
         shapes(:, 4) = sin(angle)
         friction_shapes(:, 1) = arms(1)*shares*sin(angle)
         friction_shapes(:, 2) = -arms(1)*shares*cos(angle)
         friction_shapes(:, 3) = -arms(2)*sin(angle)
         friction_shapes(:, 4) = arms(2)*cos(angle)
      end associate
      call complete_contacts(self)
      if (.not. self%is_rotating .and. self%n_phases > 0) then
         associate (n => self%n_diameters)
            call set_turns(self, self%n_phases, merge([n, n], [0, n], self%is_stationary))
         end associate
      end if
   end subroutine blade_contact_derive
end module hb_law_blade_contact
