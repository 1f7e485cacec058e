!> The course of a load over time, for time integration alone: it begins and ends, and between these times it is
!> Re(c factor(t)) with the amplitudes c = cos - i sin of its degrees of freedom.
module hb_load_course
   use hb_kinds, only: wp
   implicit none
   private
   public :: load_course_t, timed_load_t

   type, abstract :: load_course_t
      real(wp) :: begin = -huge(1.0_wp), end = huge(1.0_wp)           !! [s]
   contains
      procedure(factor_at), deferred :: factor
      procedure(highest_of), deferred :: highest_frequency
      procedure, non_overridable :: share => course_share
   end type load_course_t

   abstract interface
      !> The factor at a time; defined before the begin and after the end, too.
      pure complex(wp) function factor_at(self, time)
         import :: load_course_t, wp
         class(load_course_t), intent(in) :: self
         real(wp), intent(in) :: time                                 !! [s]
      end function factor_at

      !> Highest frequency of the factor [rad/s], which steps of time must resolve; 0: it does not oscillate.
      pure real(wp) function highest_of(self)
         import :: load_course_t, wp
         class(load_course_t), intent(in) :: self
      end function highest_of
   end interface

   !> A load with a course.
   type :: timed_load_t
      class(load_course_t), allocatable :: course
      complex(wp), allocatable :: amplitude(:)                        !! c [N], (n_dofs)
   end type timed_load_t

contains

   !> Part of an interval in which the load acts.
   pure real(wp) function course_share(self, from, to) result(share)
      class(load_course_t), intent(in) :: self
      real(wp), intent(in) :: from, to                                !! [s], ascending

      share = max(0.0_wp, min(self%end, to) - max(self%begin, from))/(to - from)
   end function course_share
end module hb_load_course
