!> Proportional damping from the matrices of a builder, D = diagonal I + mass M + stiffness K.
module hb_proportional_damping
   use hb_kinds, only: wp
   use hb_numbers, only: numbers_t
   use hb_sparse, only: sparse_identity, sparse_sum, sparse_t
   implicit none
   private
   public :: proportional_damping_t

   type :: proportional_damping_t
      real(wp) :: diagonal = 0.0_wp                          !! [N s/m] on each degree of freedom
      real(wp) :: mass = 0.0_wp                              !! [1/s], Rayleigh
      real(wp) :: stiffness = 0.0_wp                         !! [s], Rayleigh
   contains
      procedure :: declare_numbers => proportional_damping_declare_numbers
      generic :: matrix => dense_matrix, sparse_matrix
      procedure, private :: dense_matrix => proportional_damping_matrix
      procedure, private :: sparse_matrix => proportional_damping_sparse_matrix
   end type proportional_damping_t

contains

   !> Declares its numbers, for a structure that has such damping.
   subroutine proportional_damping_declare_numbers(self, numbers)
      class(proportional_damping_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("damping_diagonal", self%diagonal)
      call numbers%add("damping_mass", self%mass)
      call numbers%add("damping_stiffness", self%stiffness)
   end subroutine proportional_damping_declare_numbers

   !> Returns the damping matrix for this mass and stiffness.
   pure function proportional_damping_matrix(self, mass, stiffness) result(damping)
      class(proportional_damping_t), intent(in) :: self
      real(wp), intent(in) :: mass(:, :), stiffness(:, :)    !! (n_dofs, n_dofs)
      real(wp) :: damping(size(mass, 1), size(mass, 2))
      integer :: i

      damping = self%mass*mass + self%stiffness*stiffness
      do i = 1, size(mass, 1)
         damping(i, i) = damping(i, i) + self%diagonal
      end do
   end function proportional_damping_matrix

   !> Damping matrix of sparse mass and stiffness.
   function proportional_damping_sparse_matrix(self, mass, stiffness) result(damping)
      class(proportional_damping_t), intent(in) :: self
      type(sparse_t), intent(in) :: mass, stiffness
      type(sparse_t) :: damping

      damping = sparse_sum(self%mass, mass, self%stiffness, stiffness)
      damping = sparse_sum(1.0_wp, damping, self%diagonal, sparse_identity(mass%n_rows))
   end function proportional_damping_sparse_matrix
end module hb_proportional_damping
