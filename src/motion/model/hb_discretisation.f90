!> The discretisation in which a system is solved: harmonics, symmetry and the grid of samples. A value: another discretisation of
!> the same system is made without a copy of the system.
module hb_discretisation
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
   end type discretisation_t
end module hb_discretisation
