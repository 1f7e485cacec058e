!> Whether a structure loses energy in all its motions, so that each of them decays: with symmetric and positive definite stiffness
!> K, and damping D of which the symmetric part is positive definite, the energy v.M v/2 + x.K x/2 changes by -v.D v. Source:
!> Merkin, Introduction to the Theory of Stability, Springer 1997, chapter 6 (theorems of Kelvin, Tait and Chetaev).
module hb_dissipation
   use hb_kinds, only: wp
   use hb_lapack, only: dpotrf
   use hb_structure, only: structure_t
   use hb_thresholds, only: rounding_level
   implicit none
   private
   public :: loses_energy, work_of_dissipation

contains

   !> Whether energy is lost in all motions, as far as definite matrices show it; their rows are compared with their diagonal.
   logical function loses_energy(structure)
      type(structure_t), intent(in) :: structure                      !! with dense matrices

      associate (stiffness => structure%stiffness, damping => structure%damping)
         loses_energy = is_symmetric(stiffness)
         if (loses_energy) loses_energy = is_definite(0.5_wp*(damping + transpose(damping)))
         if (loses_energy) loses_energy = is_definite(stiffness)
      end associate
   end function loses_energy

   !> Approximate work of `loses_energy` in nanoseconds, from counts alone.
   pure real(wp) function work_of_dissipation(n_dofs) result(work)
      integer, intent(in) :: n_dofs

      work = 0.2_wp*real(n_dofs, wp)**3 + 10.0_wp*real(n_dofs, wp)**2
   end function work_of_dissipation

   !> Whether a matrix is symmetric, beside its diagonal.
   pure logical function is_symmetric(matrix)
      real(wp), intent(in) :: matrix(:, :)
      integer :: i, k

      is_symmetric = .true.
      do k = 2, size(matrix, 2)
         do i = 1, k - 1
            is_symmetric = is_symmetric .and. &
                           abs(matrix(i, k) - matrix(k, i)) <= rounding_level*sqrt(abs(matrix(i, i)))*sqrt(abs(matrix(k, k)))
         end do
      end do
   end function is_symmetric

   !> Whether a symmetric matrix is positive definite, clearly beyond rounding errors.
   logical function is_definite(matrix)
      real(wp), intent(in) :: matrix(:, :)
      real(wp), allocatable :: factor(:, :)
      integer :: i, info

      allocate (factor, source=matrix)
      do i = 1, size(matrix, 1)
         factor(i, i) = (1.0_wp - rounding_level)*matrix(i, i)
      end do
      call dpotrf("L", size(matrix, 1), factor, size(matrix, 1), info)
      is_definite = info == 0
   end function is_definite
end module hb_dissipation
