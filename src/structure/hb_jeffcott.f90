!> Jeffcott rotor in the stationary frame: a disk on a massless round shaft, optionally with the tilt of the disk and
!> its gyroscopic moment, damping that rotates with the shaft, and an elastically supported ring around the disk.
!>
!> With z = x + i y, the tilt t = tilt_x + i tilt_y (slopes dx/ds and dy/ds of the shaft at the disk) and the speed Omega:
!>
!>     m z'' + d z' + d_i (z' - i Omega z) + k z + k_c t = forces
!>     I_d t'' - i Omega I_p t' + d_t t' + k_c z + k_t t = moments
!>     m_r z_r'' + d_r z_r' + k_r z_r = forces on the ring
!>
!> Source: G. Genta, Dynamics of Rotating Systems, Springer 2005, chapters 2 to 4. Unbalance is a load, see `frequency_power`.
module hb_jeffcott
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbers_t
   use hb_proportional_damping, only: proportional_damping_t
   use hb_structure, only: label_length, new_structure, structure_t, unit_length
   use hb_structure_builder, only: structure_builder_t
   use hb_turning_frame, only: add_turned_pair, quarter_turn
   implicit none
   private
   public :: jeffcott_t, new_jeffcott

   !> Parameters of the rotor. Without a diametral inertia it has no tilt, without a ring mass no ring.
   type, extends(structure_builder_t) :: jeffcott_t
      real(wp) :: mass = 0.0_wp                              !! m [kg]
      real(wp) :: stiffness = 0.0_wp                         !! k [N/m]
      real(wp) :: damping = 0.0_wp                           !! d [N s/m], to the ground
      real(wp) :: rotating_damping = 0.0_wp                  !! d_i [N s/m], in the shaft
      real(wp) :: speed = 0.0_wp                             !! Omega [rad/s], from x towards y
      real(wp) :: diametral_inertia = 0.0_wp                 !! I_d [kg m**2]
      real(wp) :: polar_inertia = 0.0_wp                     !! I_p [kg m**2]
      real(wp) :: tilt_stiffness = 0.0_wp                    !! k_t [N m/rad]
      real(wp) :: tilt_damping = 0.0_wp                      !! d_t [N m s/rad]
      real(wp) :: coupling_stiffness = 0.0_wp                !! k_c [N/rad]
      real(wp) :: ring_mass = 0.0_wp                         !! m_r [kg]
      real(wp) :: ring_stiffness = 0.0_wp                    !! k_r [N/m]
      real(wp) :: ring_damping = 0.0_wp                      !! d_r [N s/m]
   contains
      procedure :: declare_numbers => jeffcott_declare_numbers
      procedure :: is_affine_in => jeffcott_is_affine_in
      procedure :: build => jeffcott_build
   end type jeffcott_t

contains

   subroutine jeffcott_declare_numbers(self, numbers)
      class(jeffcott_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("mass", self%mass)
      call numbers%add("stiffness", self%stiffness)
      call numbers%add("damping", self%damping)
      call numbers%add("rotating_damping", self%rotating_damping)
      call numbers%add("diametral_inertia", self%diametral_inertia)
      if (self%diametral_inertia > 0.0_wp) then
         call numbers%add("tilt_stiffness", self%tilt_stiffness)
         call numbers%add("polar_inertia", self%polar_inertia)
         call numbers%add("tilt_damping", self%tilt_damping)
         call numbers%add("coupling_stiffness", self%coupling_stiffness)
      end if
      call numbers%add("speed", self%speed, required=self%rotating_damping > 0.0_wp .or. self%polar_inertia > 0.0_wp)
      call numbers%add("ring_mass", self%ring_mass)
      if (self%ring_mass > 0.0_wp) then
         call numbers%add("ring_stiffness", self%ring_stiffness)
         call numbers%add("ring_damping", self%ring_damping)
      end if
      call self%proportional%declare_numbers(numbers)
   end subroutine jeffcott_declare_numbers

   pure logical function jeffcott_is_affine_in(self, number) result(is_affine)
      class(jeffcott_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = .true.
   end function jeffcott_is_affine_in

   subroutine jeffcott_build(self, structure, error, memory_limit)
      class(jeffcott_t), intent(inout) :: self
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit

      call new_jeffcott(structure, self, self%proportional, error)
   end subroutine jeffcott_build

   !> Creates the rotor: `x`, `y`, then `tilt_x`, `tilt_y`, then `ring_x`, `ring_y` if present. Fails if the coupling
   !> of deflection and tilt makes the shaft unstable.
   subroutine new_jeffcott(structure, rotor, damping, error)
      type(structure_t), intent(out) :: structure
      class(jeffcott_t), intent(in) :: rotor
      type(proportional_damping_t), intent(in) :: damping    !! from mass and elastic stiffness, in the stationary frame
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: damping_matrix(:, :), mass(:, :), stiffness(:, :)
      character(label_length), allocatable :: labels(:)
      character(unit_length), allocatable :: units(:)
      integer :: i, n

      labels = [character(label_length) :: "x", "y"]
      units = [character(unit_length) :: "m", "m"]
      if (rotor%diametral_inertia > 0.0_wp) then
         if (rotor%coupling_stiffness**2 > rotor%stiffness*rotor%tilt_stiffness) then
            call fail(error, "jeffcott: coupling_stiffness**2 must not exceed stiffness times tilt_stiffness")
            return
         end if
         labels = [character(label_length) :: labels, "tilt_x", "tilt_y"]
         units = [character(unit_length) :: units, "rad", "rad"]
      end if
      if (rotor%ring_mass > 0.0_wp) then
         labels = [character(label_length) :: labels, "ring_x", "ring_y"]
         units = [character(unit_length) :: units, "m", "m"]
      end if
      n = size(labels)
      allocate (mass(n, n), damping_matrix(n, n), stiffness(n, n), source=0.0_wp)

      call add_turned_pair(mass, damping_matrix, stiffness, 1, rotor%mass, rotor%damping + rotor%rotating_damping, &
                           rotor%stiffness, 0.0_wp)
      if (rotor%diametral_inertia > 0.0_wp) then
         call add_turned_pair(mass, damping_matrix, stiffness, 3, rotor%diametral_inertia, rotor%tilt_damping, &
                              rotor%tilt_stiffness, 0.0_wp)
         do i = 1, 2
            stiffness(i, i + 2) = rotor%coupling_stiffness
            stiffness(i + 2, i) = rotor%coupling_stiffness
         end do
         damping_matrix(3:4, 3:4) = damping_matrix(3:4, 3:4) - rotor%speed*rotor%polar_inertia*quarter_turn
      end if
      if (rotor%ring_mass > 0.0_wp) call add_turned_pair(mass, damping_matrix, stiffness, n - 1, rotor%ring_mass, &
                                                         rotor%ring_damping, rotor%ring_stiffness, 0.0_wp)
      damping_matrix = damping_matrix + damping%matrix(mass, stiffness)
      stiffness(1:2, 1:2) = stiffness(1:2, 1:2) - rotor%rotating_damping*rotor%speed*quarter_turn
      call new_structure(structure, mass, damping_matrix, stiffness, labels, units, error)
   end subroutine new_jeffcott
end module hb_jeffcott
