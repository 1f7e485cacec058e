!> Simply supported Euler-Bernoulli beam by its first sine modes, v(x, t) = sum over k of q_k(t) sin(k pi x/L).
!>
!> The degrees of freedom are the modal amplitudes q1, q2, ...; a law or load at the position x acts on them with the
!> weights sin(k pi x/L).
module hb_modal_beam
   use hb_beam, only: any_beam_t
   use hb_error, only: error_t
   use hb_kinds, only: pi, wp
   use hb_proportional_damping, only: proportional_damping_t
   use hb_structure, only: check_memory_of_structure, label_length, new_structure, structure_t, unit_length
   use hb_text, only: to_text
   implicit none
   private
   public :: modal_beam_t, new_modal_beam

   !> Beam by its modes; see `new_modal_beam`.
   type, extends(any_beam_t) :: modal_beam_t
      integer :: n_modes = 0
   contains
      procedure :: build => modal_beam_build
   end type modal_beam_t

contains

   subroutine modal_beam_build(self, structure, error, memory_limit)
      class(modal_beam_t), intent(inout) :: self
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit

      call check_memory_of_structure(self%n_modes, error, memory_limit)
      if (allocated(error)) return
      call new_modal_beam(structure, self%length, self%bending_stiffness, self%mass_per_length, self%n_modes, &
                          self%proportional, error)
   end subroutine modal_beam_build

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
