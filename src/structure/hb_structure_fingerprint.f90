!> Fingerprint of a structure: a checksum of its matrices and names.
module hb_structure_fingerprint
   use hb_checksum, only: checksum
   use hb_sparse, only: sparse_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: structure_fingerprint

contains

   !> Checksum of all numbers and names of a structure, and its size, in words.
   function structure_fingerprint(structure) result(text)
      type(structure_t), intent(in) :: structure
      character(80) :: text
      integer :: i, sum

      sum = 0
      if (allocated(structure%sparse)) then
         associate (m => structure%sparse%mass, d => structure%sparse%damping, k => structure%sparse%stiffness)
            sum = with_sparse(with_sparse(with_sparse(sum, m), d), k)
         end associate
      else
         do i = 1, structure%n_dofs
            sum = checksum(checksum(checksum(sum, structure%mass(:, i)), structure%damping(:, i)), structure%stiffness(:, i))
         end do
      end if
      do i = 1, structure%n_dofs
         sum = checksum(checksum(sum, structure%labels(i)), structure%units(i))
      end do
      associate (sets => structure%sets, vectors => structure%vectors)
         if (allocated(sets%names)) then
            do i = 1, size(sets%names)
               sum = checksum(sum, sets%names(i))
            end do
            sum = checksum(checksum(sum, sets%first), sets%nodes)
         end if
         if (allocated(sets%node_of)) sum = checksum(sum, sets%node_of)
         if (allocated(vectors%names)) then
            do i = 1, size(vectors%names)
               sum = checksum(sum, vectors%names(i))
            end do
            sum = checksum(checksum(checksum(sum, vectors%first), vectors%dofs), vectors%values)
         end if
      end associate
      write (text, "(a, z8.8, a, i0, a)") "CRC-32 ", sum, ", ", structure%n_dofs, " degrees of freedom"
   end function structure_fingerprint

   integer function with_sparse(so_far, matrix) result(sum)
      integer, intent(in) :: so_far
      type(sparse_t), intent(in) :: matrix

      sum = so_far
      if (allocated(matrix%value)) sum = checksum(checksum(checksum(sum, matrix%first), matrix%column), matrix%value)
   end function with_sparse
end module hb_structure_fingerprint
