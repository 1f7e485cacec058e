!> Events that the ends of a step of a curve show, and that were not located: a function, such as the distance to a stop or the
!> component of the tangent along the value, has changed its sign.
module hb_unlocated_events
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: curve_point_t
   use hb_kinds, only: wp
   use hb_located_response, only: located_response_t
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_text, only: to_text
   use hb_thresholds, only: rounding_level
   implicit none
   private
   public :: describe_unlocated

contains

   !> Says at the end of a step which events were passed on it, of how many none or not all were located; blank if all were.
   subroutine describe_unlocated(before, behind, responses, points, ending)
      type(event_values_t), intent(in) :: before, behind              !! at the ends of the step
      type(located_response_t), intent(in) :: responses(:)
      type(curve_point_t), intent(in) :: points(:)                        !! located on the step
      type(curve_point_t), intent(inout) :: ending                    !! of the step
      integer :: i, k, passed(0:ubound(curve_kinds, 1)), located(0:ubound(curve_kinds, 1))

      passed = 0
      located = 0
      call compare(curve_kind%fold, before%rise, behind%rise, count(points%kind == curve_kind%fold))
      do i = 1, size(responses)
         call compare(responses(i)%kind, before%functions(i), behind%functions(i), &
                      count(points%kind == responses(i)%kind .and. points%response == i))
      end do
      if (allocated(before%excess) .and. allocated(behind%excess)) then
         do i = 3, size(before%excess)                                ! without the ends of the range
            call compare(curve_kind%value, before%excess(i), behind%excess(i), n_at(behind%excess(i)))
         end do
      end if
      if (allocated(before%extremes) .and. allocated(behind%extremes)) then
         do k = 1, min(size(before%extremes, 2), size(behind%extremes, 2))
            ! on a circular orbit both extremes change at one point
            associate (n => count(points%kind == curve_kind%grazing .and. points%switch == k))
               if (n > 0) cycle
               i = findloc(before%extremes(:, k)*behind%extremes(:, k) < 0.0_wp, .true., dim=1)
               if (i > 0) call compare(curve_kind%grazing, before%extremes(i, k), behind%extremes(i, k), n)
            end associate
         end do
      end if
      ending%hides_fold = passed(curve_kind%fold) > 0
      ending%unlocated = ""
      associate (text => ending%unlocated)
         do k = 0, ubound(curve_kinds, 1)
            if (passed(k) == 0) cycle
            if (len_trim(text) > 0) text = trim(text)//","
            text = trim(text)//" "//to_text(passed(k))//" '"//trim(curve_kinds(k)%name)//"', "//to_text(located(k))//" located"
         end do
         text = adjustl(text)
      end associate

   contains

      !> Number of the points that are located at a wanted value, of which that at the end of the step has this excess.
      pure integer function n_at(excess) result(n)
         real(wp), intent(in) :: excess

         associate (at_end => ending%x(size(ending%x)))
            n = count([(points(i)%kind == curve_kind%value .and. &
                        abs(points(i)%x(size(points(i)%x)) - at_end + excess) <= rounding_level*abs(at_end), i=1, size(points))])
         end associate
      end function n_at

      !> Counts a function whose zeros on the step are more or fewer than its signs show.
      subroutine compare(kind, a, b, n)
         integer, intent(in) :: kind, n                               !! located zeros
         real(wp), intent(in) :: a, b
         logical :: is_changed

         is_changed = a*b < 0.0_wp .and. curve_kinds(kind)%sense*a >= 0.0_wp
         if (is_changed .eqv. modulo(n, 2) == 1) return
         if (.not. (is_changed .or. curve_kinds(kind)%sense == 0)) return
         passed(kind) = passed(kind) + merge(n + 1, n, is_changed)
         located(kind) = located(kind) + n
      end subroutine compare
   end subroutine describe_unlocated
end module hb_unlocated_events
