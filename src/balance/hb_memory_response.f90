!> Response of forces to the motion of a law with memory, including the resulting reaction of multiplier laws that
!> share degrees of freedom with it.
!>
!> Source: docs/why/theory.md, sections 5.3 to 5.6.
module hb_memory_response
   use hb_fftw, only: real_block_t
   use hb_kinds, only: wp
   use hb_sampled_law, only: sampled_law_t
   implicit none
   private
   public :: add_multiplier_response, find_response, responding_dofs

contains

   !> Computes the response, at all samples, of the forces on degree of freedom k to cos (part 1) or sin (part 2) of
   !> harmonic h of the last block, including the reaction of a multiplier law there.
   subroutine find_response(laws, i, h, part, k, samples)
      type(sampled_law_t), intent(in) :: laws(:)
      integer, intent(in) :: i                                        !! law with memory
      integer, intent(in) :: h                                        !! within the block
      integer, intent(in) :: part
      integer, intent(in) :: k                                        !! one of `responding_dofs`
      real(wp), intent(out) :: samples(:)                             !! [N/m], (n_samples)
      real(wp), allocatable :: requested(:)
      integer :: a, b, m, n, own

      samples = 0.0_wp
      call add_force_on(k, 1.0_wp, samples)
      do m = 1, size(laws)
         if (.not. laws(m)%law%is_multiplier) cycle
         own = findloc(laws(m)%columns, k, dim=1)
         if (own == 0) cycle
         allocate (requested(size(samples)))
         associate (shape => laws(m)%law%shape, columns => laws(m)%columns)
            do b = 1, size(shape, 2)
               requested = 0.0_wp
               do n = 1, size(columns)
                  if (shape(n, b) /= 0.0_wp) call add_force_on(columns(n), -shape(n, b)/sum(shape(:, b)**2), requested)
               end do
               do a = 1, size(shape, 2)
                  if (shape(own, a) /= 0.0_wp) samples = samples + shape(own, a)*laws(m)%df_dp(:, a, b)*requested
               end do
            end do
         end associate
         return                                                       ! no other multiplier acts there
      end do

   contains

      subroutine add_force_on(dof, weight, to)
         integer, intent(in) :: dof
         real(wp), intent(in) :: weight
         real(wp), intent(inout) :: to(:)
         integer :: a, row

         row = findloc(laws(i)%columns, dof, dim=1)
         if (row == 0) return
         associate (shape => laws(i)%law%shape)
            do a = 1, size(shape, 2)
               if (abs(shape(row, a)) > 0.0_wp) to = to + weight*shape(row, a)*laws(i)%hysteresis%response(:, h, part, a)
            end do
         end associate
      end subroutine add_force_on
   end subroutine find_response

   !> Degrees of freedom, among those of all laws, whose forces respond to the motion of law i, which has memory: its own and
   !> those of multiplier laws that share one with it.
   pure function responding_dofs(laws, i, n_dofs) result(dofs)
      type(sampled_law_t), intent(in) :: laws(:)
      integer, intent(in) :: i
      integer, intent(in) :: n_dofs                                   !! of all laws
      integer, allocatable :: dofs(:)
      logical :: responds(n_dofs)
      integer :: k, m

      responds = .false.
      responds(laws(i)%columns) = .true.
      do m = 1, size(laws)
         if (.not. laws(m)%law%is_multiplier) cycle
         associate (columns => laws(m)%columns)
            if (any([(any(columns(k) == laws(i)%columns), k=1, size(columns))])) responds(columns) = .true.
         end associate
      end do
      dofs = pack([(k, k=1, n_dofs)], responds)
   end function responding_dofs

   !> Adds the reactions of multiplier laws to slopes of the forces, while these contain only those of laws with
   !> memory.
   subroutine add_multiplier_response(laws, f)
      type(sampled_law_t), intent(in) :: laws(:)
      type(real_block_t), intent(inout) :: f                          !! (n_samples, n_dofs)
      real(wp), allocatable :: requested(:, :)
      integer :: a, b, k, m

      do m = 1, size(laws)
         if (.not. laws(m)%law%is_multiplier) cycle
         associate (shape => laws(m)%law%shape, columns => laws(m)%columns)
            if (allocated(requested)) deallocate (requested)
            allocate (requested(size(f%values, 1), size(shape, 2)), source=0.0_wp)
            do b = 1, size(shape, 2)
               do k = 1, size(columns)
                  if (shape(k, b) /= 0.0_wp) &
                     requested(:, b) = requested(:, b) - shape(k, b)/sum(shape(:, b)**2)*f%values(:, columns(k))
               end do
            end do
            do b = 1, size(shape, 2)
               do a = 1, size(shape, 2)
                  do k = 1, size(columns)
                     if (shape(k, a) /= 0.0_wp) &
                        f%values(:, columns(k)) = f%values(:, columns(k)) + shape(k, a)*laws(m)%df_dp(:, a, b)*requested(:, b)
                  end do
               end do
            end do
         end associate
      end do
   end subroutine add_multiplier_response
end module hb_memory_response
