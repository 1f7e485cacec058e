!> The points that are found on a step of a curve, and reported extremes.
module hb_curve_points
   use hb_curve, only: path_t
   use hb_kinds, only: wp
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_point_kinds, only: curve_kind
   use hb_stability, only: stability_t
   implicit none
   private
   public :: add_point, curve_point_t, name_unlocated, path_of, reported_extreme_t, store_path

   !> A point that was found on a step.
   type :: curve_point_t
      integer :: kind = curve_kind%none
      real(wp) :: position = 0.0_wp                                   !! position on the step
      real(wp), allocatable :: x(:)
      type(stability_t), allocatable :: stability                     !! if known
      type(motion_result_t), allocatable :: result                    !! its results, if already computed
      integer :: response = 0                                         !! number in the request of the response that is located there
      logical :: is_crossing = .false.                                !! an end at which the branch meets another curve
      logical :: is_return = .false.                                  !! an end that closes the branch
      logical :: is_last = .false.                                    !! the branch ends there, although it is no end
      integer :: bifurcation = 0                                      !! of hb_bifurcation, if it was found from multipliers
      integer :: extreme = 0, switch = 0                              !! that is zero there, of `extremes_of_switches`, if it grazes
      character(200) :: unlocated = ""                                !! events before it on the step that were not located
      logical :: hides_fold = .false.                                 !! one of these is a fold
      real(wp) :: shift = 0.0_wp                                      !! of the value, by a change of the function that vanishes
      real(wp) :: sense = 0.0_wp                                      !! of an extreme, 1: a maximum, -1: a minimum
   end type curve_point_t

   !> A fold, peak or minimum that was reported, or a fold that was passed and not located.
   type :: reported_extreme_t
      integer :: response = 0                                         !! of the request; 0: a fold
      real(wp) :: length = 0.0_wp                                     !! arc length of this branch at the point
      real(wp) :: sense = 0.0_wp                                      !! 1: a maximum, -1: a minimum, 0: not located
   end type reported_extreme_t

contains

   !> Adds a point to those of a step. (gfortran 12 leaks the components of a structure constructor within an array
   !> constructor.)
   subroutine add_point(list, kind, position, x, response)
      type(curve_point_t), allocatable, intent(inout) :: list(:)
      integer, intent(in) :: kind
      real(wp), intent(in) :: position, x(:)
      integer, intent(in), optional :: response
      type(curve_point_t) :: point

      point%kind = kind
      point%position = position
      point%x = x
      if (present(response)) point%response = response
      if (.not. allocated(list)) allocate (list(0))
      list = [list, point]
   end subroutine add_point

   !> Adds to a point events before it that were not located.
   pure subroutine name_unlocated(point, events, has_fold)
      type(curve_point_t), intent(inout) :: point
      character(*), intent(in) :: events                              !! how many of which kind; blank: none
      logical, intent(in) :: has_fold                                 !! one of these is a fold

      if (len_trim(events) == 0) return
      point%hides_fold = point%hides_fold .or. has_fold
      if (len_trim(point%unlocated) > 0) point%unlocated = trim(point%unlocated)//","
      point%unlocated = adjustl(trim(point%unlocated)//" "//events)
   end subroutine name_unlocated

   !> Stores in a row what a curve needs to continue from there, besides its point and direction.
   pure subroutine store_path(path, position)
      type(path_t), intent(in) :: path
      type(curve_position_t), intent(inout) :: position

      position%step = path%step
      position%orientation = path%orientation
      position%largest_motion = path%largest
   end subroutine store_path

   !> The path of a stored row.
   pure type(path_t) function path_of(position) result(path)
      type(curve_position_t), intent(in) :: position

      path = path_t(position%unknowns, position%direction, position%orientation, position%step, abs(position%length), &
                    position%largest_motion)
   end function path_of
end module hb_curve_points
