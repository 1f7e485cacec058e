!> A block of the dynamic stiffness S(w) = K - (w**2 + i drive) M + i w D + sum of Z(w) a b^T between given rows and
!> columns, by its nonzero entries.
!>
!> The pattern is determined once; at each frequency only the entries are computed, so that narrow structures cost
!> O(n_dofs).
module hb_structure_block
   use hb_frequency_part, only: frequency_part_t
   use hb_kinds, only: wp
   use hb_sparse, only: sparse_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: new_structure_block, structure_block_t

   !> Where a part contributes, and its share a b^T there.
   type :: share_t
      integer, allocatable :: entries(:)
      real(wp), allocatable :: values(:)                              !! (size(entries))
   end type share_t

   type :: structure_block_t
      integer :: n_entries = 0
      integer, allocatable :: row(:), column(:)                       !! (n_entries), position inside the block
      real(wp), allocatable :: mass(:), damping(:), stiffness(:)      !! (n_entries)
      type(frequency_part_t), allocatable :: parts(:)                 !! frequency-dependent parts, or not allocated
      type(share_t), allocatable :: shares(:)                         !! of each part, (n_parts)
   contains
      procedure :: set_tuple => structure_block_set_tuple
      procedure :: evaluate => structure_block_evaluate
      procedure :: scale_by => structure_block_scale_by
      procedure :: slope => structure_block_slope
      procedure :: drive_slope => structure_block_drive_slope
      procedure :: magnitude => structure_block_magnitude
      procedure :: diagonal_magnitude => structure_block_diagonal_magnitude
   end type structure_block_t

contains

   !> Collects the entries of the block with nonzero mass, damping or stiffness, column by column; without rows or
   !> columns there are no arrays.
   subroutine new_structure_block(self, structure, rows, columns)
      type(structure_block_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: rows(:), columns(:)                      !! numbers of degrees of freedom
      integer :: e, i, j, pass

      if (size(rows) == 0 .or. size(columns) == 0) return
      if (allocated(structure%sparse)) then
         call collect_sparse(self, structure, rows, columns)
         call add_parts(self, structure, rows, columns)
         return
      end if
      do pass = 1, 2                                         ! count, then fill
         e = 0
         do j = 1, size(columns)
            associate (m => structure%mass(:, columns(j)), d => structure%damping(:, columns(j)), &
                       k => structure%stiffness(:, columns(j)))
               do i = 1, size(rows)
                  if (.not. max(abs(m(rows(i))), abs(d(rows(i))), abs(k(rows(i)))) > 0.0_wp) cycle
                  e = e + 1
                  if (pass == 1) cycle
                  self%row(e) = i
                  self%column(e) = j
                  self%mass(e) = m(rows(i))
                  self%damping(e) = d(rows(i))
                  self%stiffness(e) = k(rows(i))
               end do
            end associate
         end do
         if (pass == 2) exit
         self%n_entries = e
         allocate (self%row(e), self%column(e), self%mass(e), self%damping(e), self%stiffness(e))
      end do
      call add_parts(self, structure, rows, columns)
   end subroutine new_structure_block

   !> Adds the frequency-dependent parts: their contributions to the entries, and entries that the matrices do not
   !> have.
   subroutine add_parts(self, structure, rows, columns)
      type(structure_block_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: rows(:), columns(:)
      real(wp) :: share
      integer :: e, i, j, k

      if (.not. allocated(structure%parts)) return
      self%parts = structure%parts
      allocate (self%shares(size(self%parts)))
      do k = 1, size(self%parts)
         allocate (self%shares(k)%entries(0), self%shares(k)%values(0))
         do j = 1, size(columns)
            if (.not. abs(self%parts(k)%feels(columns(j))) > 0.0_wp) cycle
            do i = 1, size(rows)
               share = self%parts(k)%acts(rows(i))*self%parts(k)%feels(columns(j))
               if (.not. abs(share) > 0.0_wp) cycle
               do e = 1, self%n_entries
                  if (self%row(e) == i .and. self%column(e) == j) exit
               end do
               self%shares(k)%entries = [self%shares(k)%entries, e]
               self%shares(k)%values = [self%shares(k)%values, share]
               if (e <= self%n_entries) cycle
               self%n_entries = e
               self%row = [self%row, i]
               self%column = [self%column, j]
            end do
         end do
      end do
      associate (none => spread(0.0_wp, 1, self%n_entries - size(self%mass)))
         self%mass = [self%mass, none]
         self%damping = [self%damping, none]
         self%stiffness = [self%stiffness, none]
      end associate
   end subroutine add_parts

   !> Collects the entries of sparse matrices, row by row.
   subroutine collect_sparse(self, structure, rows, columns)
      type(structure_block_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: rows(:), columns(:)
      integer, allocatable :: number(:), position(:)                  ! of a column in the block; of its entry in the row
      integer :: first, i, n, pass

      allocate (number(structure%n_dofs), source=0)
      do i = 1, size(columns)
         number(columns(i)) = i
      end do
      allocate (position(size(columns)))
      associate (m => structure%sparse%mass, d => structure%sparse%damping, k => structure%sparse%stiffness)
         do pass = 1, 2                                               ! count, then fill
            position = 0
            n = 0
            do i = 1, size(rows)
               first = n + 1
               call add_row(m, self%mass)
               call add_row(d, self%damping)
               call add_row(k, self%stiffness)
            end do
            if (pass == 2) exit
            self%n_entries = n
            allocate (self%row(n), self%column(n))
            allocate (self%mass(n), self%damping(n), self%stiffness(n), source=0.0_wp)
         end do
      end associate

   contains

      !> Adds a row of one of the matrices to row `i` of the block, whose entries begin with `first`.
      subroutine add_row(matrix, values)
         type(sparse_t), intent(in) :: matrix
         real(wp), allocatable, intent(inout) :: values(:)            !! of the entries of the block
         integer :: e, j

         do e = matrix%first(rows(i)), matrix%first(rows(i) + 1) - 1
            j = number(matrix%column(e))
            if (j == 0 .or. .not. abs(matrix%value(e)) > 0.0_wp) cycle
            if (position(j) < first) then
               n = n + 1
               position(j) = n
               if (pass == 2) self%row(n) = i
               if (pass == 2) self%column(n) = j
            end if
            if (pass == 2) values(position(j)) = matrix%value(e)
         end do
      end subroutine add_row
   end subroutine collect_sparse

   !> Multiplies rows and columns by factors.
   pure subroutine structure_block_scale_by(self, of_row, of_column)
      class(structure_block_t), intent(inout) :: self
      real(wp), intent(in) :: of_row(:), of_column(:)                 !! factors
      integer :: e, k

      do e = 1, self%n_entries
         associate (factor => of_row(self%row(e))*of_column(self%column(e)))
            self%mass(e) = factor*self%mass(e)
            self%damping(e) = factor*self%damping(e)
            self%stiffness(e) = factor*self%stiffness(e)
         end associate
      end do
      if (.not. allocated(self%shares)) return
      do k = 1, size(self%shares)
         associate (share => self%shares(k))
            do e = 1, size(share%entries)
               share%values(e) = of_row(self%row(share%entries(e)))*of_column(self%column(share%entries(e)))*share%values(e)
            end do
         end associate
      end do
   end subroutine structure_block_scale_by

   !> Sets the tuple of the harmonic whose entries are evaluated next.
   pure subroutine structure_block_set_tuple(self, tuple)
      class(structure_block_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)                                 !! (n_tones)
      integer :: k

      if (.not. allocated(self%parts)) return
      do k = 1, size(self%parts)
         call self%parts(k)%set_tuple(tuple)
      end do
   end subroutine structure_block_set_tuple

   !> Values of the entries, s = k - (w**2 + i drive) m + i w d, plus those of the parts.
   pure subroutine structure_block_evaluate(self, frequency, drive, s)
      class(structure_block_t), intent(in) :: self
      real(wp), intent(in) :: frequency                               !! [rad/s], of any sign
      real(wp), intent(in) :: drive                                   !! [rad**2/s**2], of any sign
      complex(wp), intent(out) :: s(:)                                !! (n_entries)
      complex(wp) :: dz_dw, z
      integer :: e, k

      if (self%n_entries == 0) return
      s = cmplx(self%stiffness - frequency**2*self%mass, frequency*self%damping - drive*self%mass, wp)
      if (.not. allocated(self%parts)) return
      do k = 1, size(self%parts)
         call self%parts(k)%evaluate(frequency, z, dz_dw)
         associate (share => self%shares(k))
            do e = 1, size(share%entries)
               s(share%entries(e)) = s(share%entries(e)) + share%values(e)*z
            end do
         end associate
      end do
   end subroutine structure_block_evaluate

   !> Derivatives of the entries by the frequency, ds/dw = -2 w m + i d, and those of the parts.
   pure subroutine structure_block_slope(self, frequency, ds_dw)
      class(structure_block_t), intent(in) :: self
      real(wp), intent(in) :: frequency                               !! [rad/s], of any sign
      complex(wp), intent(out) :: ds_dw(:)                            !! (n_entries)
      complex(wp) :: dz_dw, z
      integer :: e, k

      if (self%n_entries == 0) return
      ds_dw = cmplx(-2.0_wp*frequency*self%mass, self%damping, wp)
      if (.not. allocated(self%parts)) return
      do k = 1, size(self%parts)
         call self%parts(k)%evaluate(frequency, z, dz_dw)
         associate (share => self%shares(k))
            do e = 1, size(share%entries)
               ds_dw(share%entries(e)) = ds_dw(share%entries(e)) + share%values(e)*dz_dw
            end do
         end associate
      end do
   end subroutine structure_block_slope

   !> Derivatives of the entries by the drive, -i m.
   pure subroutine structure_block_drive_slope(self, ds_ddrive)
      class(structure_block_t), intent(in) :: self
      complex(wp), intent(out) :: ds_ddrive(:)                        !! (n_entries)

      if (self%n_entries == 0) return
      ds_ddrive = cmplx(0.0_wp, -self%mass, wp)
   end subroutine structure_block_drive_slope

   !> Magnitudes of the entries before cancellation, |k| + w**2 |m| + |w d| + sum of |Z a b|: rounding in S is
   !> relative to these.
   pure subroutine structure_block_magnitude(self, frequency, magnitude)
      class(structure_block_t), intent(in) :: self
      real(wp), intent(in) :: frequency
      real(wp), intent(out) :: magnitude(:)                           !! (n_entries)
      complex(wp) :: dz_dw, z
      integer :: e, k

      if (self%n_entries == 0) return
      magnitude = abs(self%stiffness) + frequency**2*abs(self%mass) + abs(frequency*self%damping)
      if (.not. allocated(self%parts)) return
      do k = 1, size(self%parts)
         call self%parts(k)%evaluate(frequency, z, dz_dw)
         associate (share => self%shares(k))
            do e = 1, size(share%entries)
               magnitude(share%entries(e)) = magnitude(share%entries(e)) + abs(share%values(e)*z)
            end do
         end associate
      end do
   end subroutine structure_block_magnitude

   !> Those on the diagonal of a square block, zero where it has no entry.
   pure subroutine structure_block_diagonal_magnitude(self, frequency, magnitude)
      class(structure_block_t), intent(in) :: self
      real(wp), intent(in) :: frequency
      real(wp), intent(out) :: magnitude(:)                           !! (number of rows)
      complex(wp) :: dz_dw, z
      integer :: e, i, k

      magnitude = 0.0_wp
      do e = 1, self%n_entries
         if (self%row(e) == self%column(e)) magnitude(self%row(e)) = abs(self%stiffness(e)) + frequency**2*abs(self%mass(e)) + &
                                                                    abs(frequency*self%damping(e))
      end do
      if (.not. allocated(self%parts)) return
      do k = 1, size(self%parts)
         call self%parts(k)%evaluate(frequency, z, dz_dw)
         associate (share => self%shares(k))
            do i = 1, size(share%entries)
               e = share%entries(i)
               if (self%row(e) == self%column(e)) magnitude(self%row(e)) = magnitude(self%row(e)) + abs(share%values(i)*z)
            end do
         end associate
      end do
   end subroutine structure_block_diagonal_magnitude
end module hb_structure_block
