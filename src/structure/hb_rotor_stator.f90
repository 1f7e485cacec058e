!> Bladed disk and casing by two modes of n nodal diameters each, not coupled: contact between them is a law.
!>
!> Disk u_d = q1 cos(n phi) + q2 sin(n phi), casing u_c = r1 cos(n phi) + r2 sin(n phi), with the angle phi of the
!> frame. The disk rotates at the speed Omega towards increasing angles, the casing is at rest. A travelling wave of
!> the disk against the rotation and one of the casing along it coincide at the speed (w_c + w_d)/n. Source: the paper
!> (docs/why/theory.md), section 4 and eq. (14).
module hb_rotor_stator
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbers_t
   use hb_proportional_damping, only: proportional_damping_t
   use hb_structure, only: new_structure, structure_t
   use hb_structure_builder, only: structure_builder_t
   use hb_turning_frame, only: add_turned_pair
   implicit none
   private
   public :: body_t, new_rotor_stator, rotor_stator_t

   !> One of the two bodies in its own frame.
   type :: body_t
      real(wp) :: mass = 1.0_wp                              !! modal mass [kg]
      real(wp) :: frequency = 0.0_wp                         !! [rad/s], undamped
      real(wp) :: damping_ratio = 0.0_wp
   end type body_t

   !> Disk and casing; see `new_rotor_stator`.
   type, extends(structure_builder_t) :: rotor_stator_t
      integer :: n_diameters = 1
      real(wp) :: speed = 0.0_wp                             !! Omega [rad/s]
      character(:), allocatable :: frame
      type(body_t) :: disk, casing
   contains
      procedure :: declare_numbers => rotor_stator_declare_numbers
      procedure :: is_affine_in => rotor_stator_is_affine_in
      procedure :: build => rotor_stator_build
   end type rotor_stator_t

contains

   subroutine rotor_stator_declare_numbers(self, numbers)
      class(rotor_stator_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("speed", self%speed)
      call numbers%add("disk_frequency", self%disk%frequency)
      call numbers%add("casing_frequency", self%casing%frequency)
      call numbers%add("disk_mass", self%disk%mass)
      call numbers%add("casing_mass", self%casing%mass)
      call numbers%add("disk_damping_ratio", self%disk%damping_ratio)
      call numbers%add("casing_damping_ratio", self%casing%damping_ratio)
      call self%proportional%declare_numbers(numbers)
   end subroutine rotor_stator_declare_numbers

   pure logical function rotor_stator_is_affine_in(self, number) result(is_affine)
      class(rotor_stator_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = .not. any(number%key == [character(16) :: "speed", "disk_frequency", "casing_frequency"])
   end function rotor_stator_is_affine_in

   subroutine rotor_stator_build(self, structure, error, memory_limit)
      class(rotor_stator_t), intent(inout) :: self
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit

      call new_rotor_stator(structure, self%n_diameters, self%speed, self%frame, self%disk, self%casing, self%proportional, error)
   end subroutine rotor_stator_build

   !> Creates disk and casing.
   subroutine new_rotor_stator(structure, n_diameters, speed, frame, disk, casing, damping, error)
      type(structure_t), intent(out) :: structure
      integer, intent(in) :: n_diameters
      real(wp), intent(in) :: speed                          !! Omega [rad/s]
      character(*), intent(in) :: frame                      !! `rotating` and `stationary`: both bodies in this one frame;
                                                             !! `own`: the disk in the rotating, the casing in the stationary
      type(body_t), intent(in) :: disk, casing
      type(proportional_damping_t), intent(in) :: damping    !! of either body in its own frame
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(4, 4) :: damping_matrix, mass, stiffness
      real(wp) :: casing_rate, disk_rate

      disk_rate = 0.0_wp
      casing_rate = 0.0_wp
      select case (frame)
      case ("rotating")
         casing_rate = n_diameters*speed
      case ("stationary")
         disk_rate = -n_diameters*speed
      end select                                             ! "own": neither frame rotates
      mass = 0.0_wp
      damping_matrix = 0.0_wp
      stiffness = 0.0_wp
      call add_body(disk, 1, disk_rate)
      call add_body(casing, 3, casing_rate)
      call new_structure(structure, mass, damping_matrix, stiffness, ["q1", "q2", "r1", "r2"], spread("m", 1, 4), error)

   contains

      subroutine add_body(body, first, rate)
         type(body_t), intent(in) :: body
         integer, intent(in) :: first
         real(wp), intent(in) :: rate
         real(wp) :: proportional(1, 1)

         associate (m => body%mass, k => body%mass*body%frequency**2, d => 2.0_wp*body%damping_ratio*body%mass*body%frequency)
            proportional = damping%matrix(reshape([m], [1, 1]), reshape([k], [1, 1]))
            call add_turned_pair(mass, damping_matrix, stiffness, first, m, d + proportional(1, 1), k, rate)
         end associate
      end subroutine add_body
   end subroutine new_rotor_stator
end module hb_rotor_stator
