!> Simply supported Euler-Bernoulli beam by its first sine modes, v(x, t) = sum over k of q_k(t) sin(k pi
!> x/L).
!>
!> The degrees of freedom are the modal amplitudes q1, q2, ...; a law or load at the position x acts on them with the
!> weights sin(k pi x/L).
module hb_modal_beam
   use hb_error, only: annotate, error_t
   use hb_kinds, only: pi, wp
   use hb_properties, only: properties_t
   use hb_proportional_damping, only: proportional_damping_t, read_proportional_damping
   use hb_structure, only: check_room, label_length, new_structure, structure_t, unit_length
   use hb_text, only: to_text
   implicit none
   private
   public :: new_modal_beam, read_modal_beam

contains

   !> Reads the modal beam from the keys of its group `&structure`.
   subroutine read_modal_beam(group, structure, error, memory_limit)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit         !! bytes
      type(proportional_damping_t) :: damping
      real(wp) :: bending_stiffness, length, mass_per_length
      integer :: n_modes

      call group%get("length", length)
      call group%get("bending_stiffness", bending_stiffness)
      call group%get("mass_per_length", mass_per_length)
      call group%get("n_modes", n_modes)
      call read_proportional_damping(group, damping)
      call group%finish(error)
      if (allocated(error)) return
      call check_room(n_modes, error, memory_limit)
      if (.not. allocated(error)) then
         call new_modal_beam(structure, length, bending_stiffness, mass_per_length, n_modes, damping, error)
      end if
      call annotate(error, group%place())
   end subroutine read_modal_beam

   !> Creates a modal beam, M_kk = rho A L/2 and K_kk = E I (k pi/L)**4 L/2.
   subroutine new_modal_beam(structure, length, bending_stiffness, mass_per_length, n_modes, damping, error)
      type(structure_t), intent(out) :: structure
      real(wp), intent(in) :: length                         !! L [m]
      real(wp), intent(in) :: bending_stiffness              !! E I [N m**2]
      real(wp), intent(in) :: mass_per_length                !! rho A [kg/m]
      integer, intent(in) :: n_modes
      type(proportional_damping_t), intent(in) :: damping
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: mass(:, :), stiffness(:, :)
      character(label_length), allocatable :: labels(:)
      character(unit_length), allocatable :: units(:)
      integer :: k

      allocate (mass(n_modes, n_modes), stiffness(n_modes, n_modes), source=0.0_wp)
      allocate (labels(n_modes), units(n_modes))
      units = "m"
      do k = 1, n_modes
         labels(k) = "q"//to_text(k)
         mass(k, k) = mass_per_length*length/2
         stiffness(k, k) = bending_stiffness*(real(k, wp)*pi/length)**4*length/2
      end do
      call new_structure(structure, mass, damping%matrix(mass, stiffness), stiffness, labels, units, error)
   end subroutine new_modal_beam
end module hb_modal_beam
