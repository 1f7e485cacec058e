!> The discretisation in which a system is solved: harmonics, the grid of samples, and the loads and the first guess in these
!> harmonics. A value: another discretisation of the same system is made without a copy of the system.
module hb_discretisation
   use hb_amplitudes, only: amplitudes_t
   use hb_harmonics, only: harmonics_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: discretisation_t, symmetry

   !> Among which motions a system is solved.
   type :: symmetry_t
      integer :: auto = 1                                             !! odd motions if equations and first guess are odd
      integer :: none = 2                                             !! all
      integer :: odd = 3                                              !! odd motions; rejected if the equations are not odd
   end type symmetry_t
   type(symmetry_t), parameter :: symmetry = symmetry_t()

   type :: discretisation_t
      type(harmonics_t) :: harmonics
      integer :: symmetry = symmetry%auto
      type(torus_t) :: torus                                          !! grid of samples
      type(amplitudes_t) :: loads                                     !! [N], of `harmonics`
      type(amplitudes_t) :: load_slopes                               !! their derivatives by j.omega [N s]
      type(amplitudes_t) :: start                                     !! given terms of the first guess [m]
   contains
      procedure :: clear => discretisation_clear
   end type discretisation_t

contains

   !> Deallocates everything, for the `destroy` of objects that contain a discretisation: gfortran 12 deallocates of a polymorphic
   !> object the first component of each type alone, here the loads, not the further ones.
   subroutine discretisation_clear(self)
      class(discretisation_t), intent(inout) :: self

      self%harmonics = harmonics_t()
      self%torus = torus_t()
      self%loads = amplitudes_t()
      self%load_slopes = amplitudes_t()
      self%start = amplitudes_t()
   end subroutine discretisation_clear
end module hb_discretisation
