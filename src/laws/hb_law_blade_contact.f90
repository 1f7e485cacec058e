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
   use hb_law, only: read_dofs
   use hb_law_contact_table, only: contact_table_t, make_rigid, new_contact_table, one_for_each, read_hardness, set_turns
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: blade_contact_t, new_blade_contact

   type, extends(contact_table_t) :: blade_contact_t
   contains
      procedure :: read => blade_contact_read
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
      real(wp), dimension(size(gaps), 4) :: shapes, friction_shapes
      real(wp) :: angle(size(gaps))
      integer :: i

      ! The remainder limits the angle, so that blades half a wave apart get the same digits.
      angle = [(two_pi*real(modulo(int(n_diameters, int64)*i, int(size(gaps), int64)), wp)/real(size(gaps), wp), &
                i=1, size(gaps))]
      shapes(:, 1) = -shares*cos(angle)
      shapes(:, 2) = -shares*sin(angle)
      shapes(:, 3) = cos(angle)
      shapes(:, 4) = sin(angle)
      friction_shapes(:, 1) = arms(1)*shares*sin(angle)
      friction_shapes(:, 2) = -arms(1)*shares*cos(angle)
      friction_shapes(:, 3) = -arms(2)*sin(angle)
      friction_shapes(:, 4) = arms(2)*cos(angle)
      call new_contact_table(self, shapes, gaps, stiffness, friction, friction_shapes)
   end subroutine new_blade_contact

   !> Reads a `&law type = 'blade_contact'` group.
   subroutine blade_contact_read(self, group, structure)
      class(blade_contact_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      real(wp), allocatable :: arms(:), friction(:), gaps(:), shares(:), stiffness(:)
      character(:), allocatable :: frame, failure
      integer :: n_blades, n_diameters, tone
      real(wp) :: augmentation
      logical :: is_rigid

      tone = 0
      self%has_potential = .true.                                     ! until determined
      call read_dofs(self, group, structure)
      call group%get("n_diameters", n_diameters)
      call group%get("n_blades", n_blades)
      call group%get("gaps", gaps)
      call read_hardness(group, is_rigid, stiffness, augmentation)
      call group%get("friction_coefficient", friction)
      call group%get("shares", shares)
      call group%get("frame", frame)
      arms = [0.0_wp, 0.0_wp]
      call group%get("friction_arms", arms, n=2, required=any(friction > 0.0_wp))
      if (frame /= "rotating") call group%get("tone", tone)
      if (.not. (allocated(self%dofs) .and. allocated(gaps) .and. allocated(stiffness))) return
      if (size(self%dofs) /= 4) call group%problem("dofs", "name both coordinates of the disk, then both of the casing")
      if (n_blades < 1 .or. n_diameters < 1) return
      call one_for_each(group, "gaps", gaps, n_blades)
      call one_for_each(group, "stiffness", stiffness, n_blades)
      call one_for_each(group, "friction_coefficient", friction, n_blades)
      call one_for_each(group, "shares", shares, n_blades)
      if (any([size(gaps), size(stiffness), size(friction), size(shares)] /= n_blades) .or. size(arms) /= 2) return
      call new_blade_contact(self, n_diameters, gaps, stiffness, friction, arms, shares)
      if (is_rigid) then
         call make_rigid(self, augmentation, failure)
         if (len(failure) > 0) call group%problem("contact", failure)
      end if
      if (tone < 1 .or. size(self%dofs) /= 4) return
      call set_turns(self, tone, merge([n_diameters, n_diameters], [0, n_diameters], frame == "stationary"))
   end subroutine blade_contact_read
end module hb_law_blade_contact
