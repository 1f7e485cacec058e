!> A structure as one sector of a wheel of equal ones, in motions that travel from sector to sector.
!>
!> Where the motion of each sector is that of the sector before, delayed by the angle 2 pi EO_m/N of each tone m with the engine
!> order EO_m, harmonic j has in the next sector the amplitude c exp(-2 pi i d/N), with the nodal diameter d = sum of j_m EO_m. One
!> sector then has the equations of the wheel. A copy is a degree of freedom of this sector that is one of the next: the constraint
!> q_copy = exp(-2 pi i d/N) q_original of each harmonic, by a Lagrange multiplier, so that matrices, laws and loads of copies are
!> those of any degree of freedom. Source: docs/why/theory.md, section 4; D. L. Thomas, Int. J. Num. Meth. Eng. 14 (1979).
module hb_sector
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_kinds, only: wp
   use hb_numbers, only: numbers_t
   use hb_problems, only: problems_t
   use hb_sparse, only: sparse_from_entries, sparse_sum
   use hb_structure, only: structure_t
   use hb_structure_element, only: dof_key_length, structure_element_t
   implicit none
   private
   public :: sector_t

   type, extends(structure_element_t) :: sector_t                     ! its degrees of freedom: originals, then their copies
      integer :: n_sectors = 0                                        !! N
      integer, allocatable :: engine_orders(:)                        !! nodal diameter of each tone, of any sign
   contains
      procedure :: declare_numbers => sector_declare_numbers
      procedure :: has_valid_numbers => sector_has_valid_numbers
      procedure :: check => sector_check
      procedure :: get_dof_keys => sector_get_dof_keys
      procedure :: n_dofs => sector_n_dofs
      procedure :: add_to => sector_add_to
      procedure :: wanted_dofs => sector_wanted_dofs
      procedure :: n_tones => sector_n_tones
   end type sector_t

contains

   subroutine sector_declare_numbers(self, numbers)
      class(sector_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("n_sectors", self%n_sectors)
      call numbers%add("engine_orders", self%engine_orders)
   end subroutine sector_declare_numbers

   logical function sector_has_valid_numbers(self) result(are_valid)
      class(sector_t), intent(in) :: self

      are_valid = self%n_sectors > 1 .and. allocated(self%engine_orders)
   end function sector_has_valid_numbers

   !> Reports lists that are not of pairs.
   subroutine sector_check(self, problems)
      class(sector_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems
      integer :: n_links

      if (.not. allocated(self%engine_orders)) &
         call problems%add("engine_orders", "the nodal diameter of each tone is needed, such as 3, or -3 of a wave that "// &
                           "travels the other way")
      if (.not. allocated(self%dofs)) return                          ! which has been reported
      n_links = size(self%dofs)/2
      if (mod(size(self%dofs), 2) /= 0) then
         call problems%add("high", "as many degrees of freedom are needed as 'low' has: each is that of 'low' in the next sector")
      else if (has_common(self%dofs(:n_links), self%dofs(n_links + 1:))) then
         call problems%add("high", "a degree of freedom is in 'low', too; each belongs to one boundary")
      end if

   contains

      pure logical function has_common(list, other)
         integer, intent(in) :: list(:), other(:)
         integer :: i

         has_common = any([(any(list == other(i)), i=1, size(other))])
      end function has_common
   end subroutine sector_check

   !> The originals, and the copies.
   pure subroutine sector_get_dof_keys(self, keys)
      class(sector_t), intent(in) :: self
      character(dof_key_length), allocatable, intent(out) :: keys(:)

      keys = [character(dof_key_length) :: "low", "high"]
   end subroutine sector_get_dof_keys

   !> Any number.
   pure integer function sector_n_dofs(self) result(n_dofs)
      class(sector_t), intent(in) :: self

      n_dofs = 0
   end function sector_n_dofs

   pure integer function sector_n_tones(self) result(n_tones)
      class(sector_t), intent(in) :: self

      n_tones = size(self%engine_orders)
   end function sector_n_tones

   !> Adds a multiplier for each copy, its force on the copy, and parts for the original, which depend on the tuple; and springs
   !> between copy and original, which remain unstressed: no row without a diagonal but those of multipliers.
   subroutine sector_add_to(self, structure)
      class(sector_t), intent(in) :: self
      type(structure_t), intent(inout) :: structure
      type(frequency_part_t), allocatable :: parts(:)
      real(wp), allocatable :: damping(:), mass(:), stiffness(:)
      real(wp) :: scales(size(self%dofs)/2)
      integer :: i, n, n_links

      n_links = size(scales)
      n = structure%n_dofs
      call structure%diagonals(mass, damping, stiffness)
      associate (originals => self%dofs(:n_links), copies => self%dofs(n_links + 1:))
         scales = abs(stiffness(originals)) + abs(stiffness(copies))  ! any positive ones: multipliers are lengths
         where (.not. scales > 0.0_wp) scales = maxval(abs(stiffness))
         where (.not. scales > 0.0_wp) scales = 1.0_wp
         call add_links(structure, originals, copies, scales)
         allocate (parts(2*n_links))
         do i = 1, n_links
            parts(2*i - 1) = part_between([copies(i), n + i], [originals(i)], .false.)
            parts(2*i) = part_between([originals(i)], [copies(i), n + i], .true.)
         end do
      end associate
      call structure%add_parts(parts)

   contains

      !> The force on some degrees of freedom by others, in the next or the previous sector.
      function part_between(force_dofs, dofs, is_of_previous) result(part)
         integer, intent(in) :: force_dofs(:), dofs(:)
         logical, intent(in) :: is_of_previous
         type(frequency_part_t) :: part

         part%kind = kind_of_part%neighbour
         part%is_of_element = .true.
         part%n_sectors = self%n_sectors
         allocate (part%engine_orders, source=self%engine_orders)
         part%is_of_previous = is_of_previous
         part%copy = self%dofs(n_links + i)
         part%stiffness = -scales(i)
         allocate (part%acts(structure%n_dofs), part%feels(structure%n_dofs), source=0.0_wp)
         part%acts(force_dofs) = 1.0_wp
         part%feels(dofs) = 1.0_wp
      end function part_between
   end subroutine sector_add_to

   !> Adds the multipliers of copies to a structure, and springs between copies and originals.
   subroutine add_links(structure, originals, copies, scales)
      type(structure_t), intent(inout) :: structure
      integer, intent(in) :: originals(:), copies(:)                  !! degrees of freedom
      real(wp), intent(in) :: scales(:)                               !! stiffness between a multiplier and its copy [N/m]
      integer :: i, n

      n = structure%n_dofs
      call structure%append_dofs("link", structure%units(copies))
      if (allocated(structure%sparse)) then
         associate (links => [(n + i, i=1, size(copies))])
            structure%sparse%stiffness = sparse_sum(1.0_wp, structure%sparse%stiffness, 1.0_wp, &
                                                    sparse_from_entries(structure%n_dofs, [links, copies, copies, originals], &
                                                                        [copies, links, copies, originals], &
                                                                        [scales, scales, scales, scales]))
         end associate
         return
      end if
      do i = 1, size(copies)
         structure%stiffness(n + i, copies(i)) = scales(i)
         structure%stiffness(copies(i), n + i) = scales(i)
         structure%stiffness(copies(i), copies(i)) = structure%stiffness(copies(i), copies(i)) + scales(i)
         structure%stiffness(originals(i), originals(i)) = structure%stiffness(originals(i), originals(i)) + scales(i)
      end do
   end subroutine add_links

   !> The degrees of freedom of copies and originals on which laws act both, and their multipliers: where both are unknowns, the
   !> constraint cannot be eliminated.
   pure function sector_wanted_dofs(self, structure, is_used) result(dofs)
      class(sector_t), intent(in) :: self
      type(structure_t), intent(in) :: structure                      !! with this sector
      logical, intent(in) :: is_used(:)                               !! (structure%n_dofs), by laws
      integer, allocatable :: dofs(:)
      integer :: i, k, n_links

      allocate (dofs(0))
      if (.not. (allocated(self%dofs) .and. allocated(structure%parts))) return ! the input has problems
      n_links = size(self%dofs)/2
      do i = 1, n_links
         if (.not. (is_used(self%dofs(i)) .and. is_used(self%dofs(n_links + i)))) cycle
         do k = 1, size(structure%parts)
            if (structure%parts(k)%kind /= kind_of_part%neighbour .or. structure%parts(k)%is_of_previous) cycle
            if (structure%parts(k)%copy == self%dofs(n_links + i)) &
               dofs = [dofs, self%dofs([i, n_links + i]), findloc(structure%parts(k)%acts > 0.0_wp, .true., dim=1, back=.true.)]
         end do
      end do
   end function sector_wanted_dofs
end module hb_sector
