!> Whether a branch of a curve returns to motions that it has passed, apart from their phases (hb_motion_images).
module hb_curve_return
   use hb_curve_course, only: curve_course_t
   use hb_discretisation, only: discretisation_t
   use hb_followed, only: followed_t
   use hb_kinds, only: wp
   use hb_level, only: level_of, level_t, transferred
   use hb_motion_result, only: curve_position_t
   use hb_point_kinds, only: curve_kind
   use hb_thresholds, only: certainty_factor, negligible_share
   implicit none
   private
   public :: note_course, restore_course

contains

   !> Notes a fold or the end of a step of a branch whose motions have images: the branch may have come back to one of its folds, or
   !> its tones may lock ahead.
   subroutine note_course(followed, course, kind, x, length)
      class(followed_t), intent(inout), target :: followed
      type(curve_course_t), intent(inout) :: course
      integer, intent(in) :: kind
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: length                                  !! of the arc up to there
      real(wp), allocatable :: omega(:)
      integer :: i

      select case (kind)
      case (curve_kind%fold)
         do i = 1, size(course%folds)
            if (is_at_fold(followed, course, i, x, length)) course%is_retraced = .true.
         end do
         call course%add_fold(x, followed%level, length)
      case (curve_kind%regular)
         call followed%find_drifting_tones(x, omega)
         if (.not. allocated(omega)) return
         call course%add_step(x(size(x)), omega)
         call course%find_locking(followed%model%system%tones, followed%model%options%error_estimate%commensurability)
      end select
   end subroutine note_course

   !> Whether a fold is the i-th one that the branch has passed, apart from its phases, although the branch has been elsewhere in
   !> between.
   logical function is_at_fold(followed, course, i, x, length)
      class(followed_t), intent(in) :: followed
      type(curve_course_t), intent(in) :: course
      integer, intent(in) :: i
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: length                                  !! of the arc up to there
      real(wp) :: near, there(size(x))

      near = negligible_share
      associate (accuracy => followed%model%options%accuracy, passed => course%folds(i))
         if (accuracy%is_on) near = max(near, accuracy%tolerance)
         is_at_fold = length - passed%length > certainty_factor*near
         if (.not. is_at_fold) return
         there = transferred(passed%level%harmonics, followed%level%harmonics, passed%x, followed%n_further)
         call followed%bring_near(x, there)
         is_at_fold = norm2((there - x)/followed%units_at(x)) <= near
      end associate
   end function is_at_fold

   !> Stores the course of a branch, whose motions have images, up to its last stored point.
   subroutine restore_course(followed, course, stored, discretisation)
      class(followed_t), intent(inout), target :: followed
      type(curve_course_t), intent(inout) :: course
      type(curve_position_t), intent(in) :: stored(:)                 !! points of this branch, with those before it of other sign
      type(discretisation_t), intent(in) :: discretisation            !! of the model
      type(level_t) :: level
      real(wp), allocatable :: x(:)
      integer :: i

      do i = 1, size(stored)
         if (stored(i)%length*stored(size(stored))%length < 0.0_wp) cycle
         level = level_of(discretisation, stored(i))
         x = transferred(level%harmonics, followed%level%harmonics, stored(i)%unknowns, followed%n_further)
         call note_course(followed, course, stored(i)%kind, x, abs(stored(i)%length))
      end do
   end subroutine restore_course
end module hb_curve_return
