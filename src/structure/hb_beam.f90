!> Plane Euler-Bernoulli beam of equal Hermite cubic elements with consistent mass.
!>
!> Each node has a deflection `v` and a rotation `theta`, numbered from the left; dofs are ordered node by node, v
!> before theta, and those fixed by a support are omitted. With an even number of elements the midspan is
!> `v(n_elements/2 + 1)`. Source of the element matrices: J. S. Przemieniecki, Theory of Matrix Structural Analysis,
!> 1968, sections 5.6 and 11.3 (without shear and rotatory inertia).
module hb_beam
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbers_t
   use hb_proportional_damping, only: proportional_damping_t
   use hb_structure, only: check_memory_of_structure, label_length, new_structure, structure_t, unit_length
   use hb_structure_builder, only: structure_builder_t
   use hb_text, only: to_text
   implicit none
   private
   public :: any_beam_t, beam_t, new_beam

   !> The numbers of a beam, whatever represents it.
   type, extends(structure_builder_t), abstract :: any_beam_t
      real(wp) :: length = 0.0_wp                            !! [m]
      real(wp) :: bending_stiffness = 0.0_wp                 !! E I [N m**2]
      real(wp) :: mass_per_length = 0.0_wp                   !! rho A [kg/m]
   contains
      procedure :: declare_numbers => any_beam_declare_numbers
      procedure :: is_affine_in => any_beam_is_affine_in
   end type any_beam_t

   !> Beam of elements; see `new_beam`.
   type, extends(any_beam_t) :: beam_t
      integer :: n_elements = 0
      character(7) :: ends(2) = "pinned"
   contains
      procedure :: build => beam_build
   end type beam_t

contains

   subroutine any_beam_declare_numbers(self, numbers)
      class(any_beam_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("length", self%length)
      call numbers%add("bending_stiffness", self%bending_stiffness)
      call numbers%add("mass_per_length", self%mass_per_length)
      call self%proportional%declare_numbers(numbers)
   end subroutine any_beam_declare_numbers

   pure logical function any_beam_is_affine_in(self, number) result(is_affine)
      class(any_beam_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = number%key /= "length"
   end function any_beam_is_affine_in

   subroutine beam_build(self, structure, error, memory_limit)
      class(beam_t), intent(inout) :: self
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit

      call check_memory_of_structure(2*self%n_elements + 2, error, memory_limit)
      if (allocated(error)) return
      call new_beam(structure, self%length, self%bending_stiffness, self%mass_per_length, self%n_elements, self%ends, &
                    self%proportional, error)
   end subroutine beam_build

   !> Creates a beam; fails if no degree of freedom is free.
   subroutine new_beam(structure, length, bending_stiffness, mass_per_length, n_elements, ends, damping, error)
      type(structure_t), intent(out) :: structure
      real(wp), intent(in) :: length                         !! [m]
      real(wp), intent(in) :: bending_stiffness              !! E I [N m**2]
      real(wp), intent(in) :: mass_per_length                !! rho A [kg/m]
      integer, intent(in) :: n_elements
      character(*), intent(in) :: ends(2)                    !! left and right: `pinned`, `clamped`, `free` or `guided`
      type(proportional_damping_t), intent(in) :: damping
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: mass(:, :), stiffness(:, :)
      character(label_length), allocatable :: labels(:)
      character(unit_length), allocatable :: units(:)
      logical, allocatable :: is_free(:)
      integer, allocatable :: retained(:)
      real(wp) :: element_mass(4, 4), element_stiffness(4, 4)
      integer :: i, n_all

      n_all = 2*(n_elements + 1)
      allocate (mass(n_all, n_all), stiffness(n_all, n_all), source=0.0_wp)
      element_mass = hermite_mass(mass_per_length, length/real(n_elements, wp))
      element_stiffness = hermite_stiffness(bending_stiffness, length/real(n_elements, wp))
      do i = 1, 2*n_elements, 2
         mass(i:i + 3, i:i + 3) = mass(i:i + 3, i:i + 3) + element_mass
         stiffness(i:i + 3, i:i + 3) = stiffness(i:i + 3, i:i + 3) + element_stiffness
      end do

      allocate (is_free(n_all), source=.true.)
      is_free(:2) = is_free_at(ends(1))
      is_free(n_all - 1:) = is_free_at(ends(2))
      retained = pack([(i, i=1, n_all)], is_free)
      if (size(retained) == 0) then
         call fail(error, "beam: one element between clamped ends has no degree of freedom; use 2 or more")
         return
      end if

      allocate (labels(n_all), units(n_all))
      do i = 1, n_elements + 1
         labels(2*i - 1) = "v"//to_text(i)
         labels(2*i) = "theta"//to_text(i)
         units(2*i - 1) = "m"
         units(2*i) = "rad"
      end do
      mass = mass(retained, retained)
      stiffness = stiffness(retained, retained)
      call new_structure(structure, mass, damping%matrix(mass, stiffness), stiffness, labels(retained), &
                         units(retained), error)
   end subroutine new_beam

   !> Whether deflection and rotation of a node at this support are free.
   pure function is_free_at(support) result(is_free)
      character(*), intent(in) :: support
      logical :: is_free(2)

      select case (support)
      case ("pinned")
         is_free = [.false., .true.]
      case ("guided")
         is_free = [.true., .false.]
      case ("free")
         is_free = .true.
      case default                                           ! clamped
         is_free = .false.
      end select
   end function is_free_at

   !> Stiffness of one element of length `l` for the dofs v, theta at the left and v, theta at the right node.
   pure function hermite_stiffness(bending_stiffness, l) result(k)
      real(wp), intent(in) :: bending_stiffness, l
      real(wp) :: k(4, 4)

      k(:, 1) = [12.0_wp, 6*l, -12.0_wp, 6*l]
      k(:, 2) = [6*l, 4*l**2, -6*l, 2*l**2]
      k(:, 3) = -k(:, 1)
      k(:, 4) = [6*l, 2*l**2, -6*l, 4*l**2]
      k = bending_stiffness/l**3*k
   end function hermite_stiffness

   !> Consistent mass of one element, same order as `hermite_stiffness`.
   pure function hermite_mass(mass_per_length, l) result(m)
      real(wp), intent(in) :: mass_per_length, l
      real(wp) :: m(4, 4)

      m(:, 1) = [156.0_wp, 22*l, 54.0_wp, -13*l]
      m(:, 2) = [22*l, 4*l**2, 13*l, -3*l**2]
      m(:, 3) = [54.0_wp, 13*l, 156.0_wp, -22*l]
      m(:, 4) = [-13*l, -3*l**2, -22*l, 4*l**2]
      m = mass_per_length*l/420.0_wp*m
   end function hermite_mass
end module hb_beam
