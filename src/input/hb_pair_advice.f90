!> Pairs of nodes that a law meets in the order of two sets, although another node of the second set is nearer to the first one.
module hb_pair_advice
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_advice, only: advice, advice_list_t
   use hb_kinds, only: wp
   use hb_node_sets, only: node_sets_t
   use hb_system, only: system_t
   implicit none
   private
   public :: advise_on_pairs

   integer, parameter :: max_pairs = 3000                             ! of a group: distances of all are compared, 0.05 s
   real(wp), parameter :: clearly_nearer = 0.9_wp                     ! distance of another node relative to that of the partner

contains

   !> Names for each group of laws the first pair whose partner is not the nearest node.
   subroutine advise_on_pairs(system, list)
      type(system_t), intent(in) :: system                            !! with places of its nodes
      type(advice_list_t), intent(inout) :: list
      integer, allocatable :: laws(:)
      integer :: group, i

      do group = 1, maxval([0, system%law_groups])
         laws = pack([(i, i=1, size(system%law_groups))], system%law_groups == group)
         if (size(laws) < 2 .or. size(laws) > max_pairs) cycle
         call advise_on_group(system, laws, list)
      end do
   end subroutine advise_on_pairs

   subroutine advise_on_group(system, laws, list)
      type(system_t), intent(in) :: system
      integer, intent(in) :: laws(:)                                  !! of one group
      type(advice_list_t), intent(inout) :: list
      integer :: first(size(laws)), i, n_wrong, nearest, second(size(laws)), worst
      real(wp) :: distance(size(laws)), distances(2)

      do i = 1, size(laws)
         call find_nodes(system, laws(i), first(i), second(i))
         if (first(i) == 0 .or. second(i) == 0) return
      end do
      associate (x => system%structure%sets%coordinates)
         if (.not. all(ieee_is_finite(x(:, [first, second])))) return
         n_wrong = 0
         worst = 0
         nearest = 0
         distances = 0.0_wp
         do i = 1, size(laws)
            distance = norm2(x(:, second) - spread(x(:, first(i)), 2, size(laws)), dim=1)
            if (minval(distance) >= clearly_nearer*distance(i)) cycle
            n_wrong = n_wrong + 1
            if (worst > 0) cycle
            worst = i
            nearest = minloc(distance, dim=1)
            distances = [distance(i), distance(nearest)]
         end do
      end associate
      if (n_wrong == 0) return
      call list%add(advice%crossed_pairs, [distances, real(n_wrong, wp)], system%laws(laws(worst))%law%label, &
                    label_of(system, laws(worst), 2), label_of(system, laws(nearest), 2))
   end subroutine advise_on_group

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
      character(len(system%structure%labels)) :: text

      text = system%structure%labels(system%laws(i)%law%dofs(k))
   end function label_of
end module hb_pair_advice
