!> Pairs of nodes that a law meets in the order of two sets, although another node of the second set is nearer to the first one.
module hb_pair_warnings
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_kinds, only: wp
   use hb_node_sets, only: node_sets_t
   use hb_system, only: system_t
   use hb_text, only: number_of, rounded, string_t
   implicit none
   private
   public :: describe_pairs

   integer, parameter :: max_pairs = 3000                             ! of a group: distances of all are compared, 0.05 s
   real(wp), parameter :: clearly_nearer = 0.9_wp                     ! distance of another node relative to that of the partner

contains

   !> Describes for each group of laws the first pair whose partner is not the nearest node; none without places of nodes.
   subroutine describe_pairs(system, lines)
      type(system_t), intent(in) :: system
      type(string_t), allocatable, intent(out) :: lines(:)
      integer, allocatable :: laws(:)
      integer :: group, i

      allocate (lines(0))
      if (.not. allocated(system%structure%sets%coordinates) .or. .not. allocated(system%law_groups)) return
      do group = 1, maxval([0, system%law_groups])
         laws = pack([(i, i=1, size(system%law_groups))], system%law_groups == group)
         if (size(laws) < 2 .or. size(laws) > max_pairs) cycle
         call describe_group(system, laws, lines)
      end do
   end subroutine describe_pairs

   subroutine describe_group(system, laws, lines)
      type(system_t), intent(in) :: system
      integer, intent(in) :: laws(:)                                  !! of one group
      type(string_t), allocatable, intent(inout) :: lines(:)
      type(string_t) :: line
      integer :: first(size(laws)), i, n_wrong, nearest, second(size(laws)), worst
      real(wp) :: distance(size(laws)), least

      do i = 1, size(laws)
         call find_nodes(system, laws(i), first(i), second(i))
         if (first(i) == 0 .or. second(i) == 0) return
      end do
      associate (x => system%structure%sets%coordinates)
         if (.not. all(ieee_is_finite(x(:, [first, second])))) return
         n_wrong = 0
         worst = 0
         do i = 1, size(laws)
            distance = norm2(x(:, second) - spread(x(:, first(i)), 2, size(laws)), dim=1)
            if (minval(distance) >= clearly_nearer*distance(i)) cycle
            n_wrong = n_wrong + 1
            if (worst > 0) cycle
            worst = i
            nearest = minloc(distance, dim=1)
            least = distance(nearest)
            line%value = "'"//system%laws(laws(i))%law%label//"' meets "//label_of(system, laws(i), 2)//" at a distance of "// &
               rounded(distance(i))//" m, although "//label_of(system, laws(nearest), 2)//" is nearer, "//rounded(least)//" m"
         end do
      end associate
      if (n_wrong == 0) return
      line%value = line%value//": sets are paired in their order (so with "//number_of(n_wrong, "pair")// &
         "); list their nodes in one order"
      lines = [lines, line]
   end subroutine describe_group

   !> The nodes of a relative coordinate of a law, 0 for another coordinate.
   subroutine find_nodes(system, i, first, second)
      type(system_t), intent(in) :: system
      integer, intent(in) :: i
      integer, intent(out) :: first, second

      first = 0
      second = 0
      associate (law => system%laws(i)%law, node_of => system%structure%sets%node_of)
         if (.not. (allocated(law%dofs) .and. allocated(law%shape))) return
         if (size(law%dofs) < 2) return
         if (law%shape(1, 1)*law%shape(2, 1) >= 0.0_wp) return
         if (any(law%shape(3:, 1) /= 0.0_wp)) return
         first = node_of(law%dofs(1))
         second = node_of(law%dofs(2))
      end associate
   end subroutine find_nodes

   pure function label_of(system, i, k) result(text)
      type(system_t), intent(in) :: system
      integer, intent(in) :: i, k                                     !! law and degree of freedom of it
      character(len_trim(system%structure%labels(system%laws(i)%law%dofs(k))) + 2) :: text

      text = "'"//trim(system%structure%labels(system%laws(i)%law%dofs(k)))//"'"
   end function label_of
end module hb_pair_warnings
