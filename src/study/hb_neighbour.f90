!> First guesses from neighbours: each point of a chain along a swept parameter starts from the solutions of its
!> predecessors, never from a point of another chain, so that the results do not depend on the distribution of the
!> chains over ranks or on the time.
module hb_neighbour
   use hb_branches, only: is_far_above
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_level, only: coarsen, level_t, loaded_tuples, transferred
   use hb_model, only: model_t
   implicit none
   private
   public :: neighbour_t

   real(wp), parameter :: max_extrapolation = 4.0_wp                  ! limit of the extrapolation, in steps between its points
   integer, parameter :: longest_pause = 8                            ! points

   !> The last two solutions of a chain. By tolerance a point starts on the set of the last one. Where such a set had to grow, a few
   !> points start on a part of it, and more of them each time: large levels that decide nothing cost most.
   type :: neighbour_t
      private
      integer :: n_retained = 0
      integer :: pause = 0                                            ! points that start on a part of the set after it had to grow
      integer :: n_left = 0                                           ! of them
      type(level_t) :: last                                           ! with its grid, if points choose their own
      real(wp), allocatable :: before(:)                              ! unknowns in the same set
      real(wp) :: last_value = 0.0_wp, before_value = 0.0_wp
   contains
      procedure :: forget => neighbour_forget
      procedure :: store => neighbour_store
      procedure :: predict => neighbour_predict
      procedure :: predict_level => neighbour_predict_level
      procedure :: starts_small => neighbour_starts_small
   end type neighbour_t

contains

   !> Removes all solutions: a new chain begins, or a point was not solved.
   pure subroutine neighbour_forget(self)
      class(neighbour_t), intent(inout) :: self

      self%n_retained = 0
   end subroutine neighbour_forget

   !> Stores the solution of a point. The previous one is removed if its harmonics differ or if the motion has jumped:
   !> a line through two branches is of no use.
   pure subroutine neighbour_store(self, parameter, level, n_levels)
      class(neighbour_t), intent(inout) :: self
      real(wp), intent(in) :: parameter                               !! its value at the point, in the unit of the input
      type(level_t), intent(in) :: level                              !! set, grid and unknowns of the point
      integer, intent(in) :: n_levels                                 !! that the point has needed
      logical :: is_same

      if (self%n_left > 0) then
         self%n_left = self%n_left - 1
      else if (self%n_retained > 0) then
         self%pause = merge(max(1, min(longest_pause, 2*self%pause)), 0, n_levels > 1)
         self%n_left = self%pause
      end if
      is_same = .false.
      if (allocated(self%last%unknowns)) &
         is_same = size(level%unknowns) == size(self%last%unknowns) .and. level%harmonics%equal(self%last%harmonics)
      if (.not. is_same) self%n_retained = 0
      if (self%n_retained == 2) then
         if (has_jumped(self, parameter, level%unknowns)) self%n_retained = 0
      end if
      if (self%n_retained > 0) then
         self%before = self%last%unknowns
         self%before_value = self%last_value
      end if
      if (.not. is_same) self%last%harmonics = level%harmonics
      self%last%torus = level%torus
      self%last%unknowns = level%unknowns
      self%last_value = parameter
      self%n_retained = min(2, self%n_retained + 1)
   end subroutine neighbour_store

   !> Returns a first guess for the next point, unallocated if there is no neighbour: the last solution x1 or, with
   !> two of them of the same harmonics, the line x1 + (x1 - x0) (p - p1)/(p1 - p0) through both. Harmonics that the
   !> last one lacks are zero.
   pure subroutine neighbour_predict(self, parameter, set, secant, start)
      class(neighbour_t), intent(in) :: self
      real(wp), intent(in) :: parameter
      type(harmonics_t), intent(in) :: set                            !! of the next point
      logical, intent(in) :: secant                                   !! false: the unchanged last solution
      real(wp), allocatable, intent(out) :: start(:)

      if (self%n_retained == 0) return
      if (.not. set%equal(self%last%harmonics)) then
         start = transferred(self%last%harmonics, set, self%last%unknowns, set%n_tones) ! the base frequencies follow
         return
      end if
      start = self%last%unknowns
      if (.not. secant .or. self%n_retained < 2) return
      if (.not. abs(parameter - self%last_value) <= max_extrapolation*abs(self%last_value - self%before_value)) return
      start = start + (start - self%before)*((parameter - self%last_value)/(self%last_value - self%before_value))
   end subroutine neighbour_predict

   !> Returns the set and the grid of the last point with a first guess in them, if there is one; neighbours share sets as
   !> long as these are suitable.
   subroutine neighbour_predict_level(self, parameter, model, level)
      class(neighbour_t), intent(in) :: self
      real(wp), intent(in) :: parameter
      type(model_t), intent(in) :: model
      type(level_t), intent(out) :: level

      associate (options => model%options)
         if (self%n_retained == 0) return
         level = self%last
         call self%predict(parameter, self%last%harmonics, options%chain%secant, level%unknowns)
         if (self%starts_small() .and. options%accuracy%grows_set .and. size(level%torus%n_samples) > 1) & ! one tone costs little
            call coarsen(model%system, options, loaded_tuples(model%system), level)
      end associate
   end subroutine neighbour_predict_level

   !> Whether the next point starts on a part of the last set.
   pure logical function neighbour_starts_small(self) result(starts_small)
      class(neighbour_t), intent(in) :: self

      starts_small = self%n_left > 0
   end function neighbour_starts_small

   !> Whether the motion has left the branch of the previous points, as far as these show.
   pure logical function has_jumped(self, parameter, unknowns)
      type(neighbour_t), intent(in) :: self
      real(wp), intent(in) :: parameter, unknowns(:)
      real(wp) :: slope, slope_before

      has_jumped = .false.
      ! base frequencies follow the coefficients
      associate (n => size(unknowns) - self%last%harmonics%n_tones, p => self%last_value)
         if (.not. (abs(parameter - p) > 0.0_wp .and. abs(p - self%before_value) > 0.0_wp)) return
         slope = norm2(unknowns(:n) - self%last%unknowns(:n))/abs(parameter - p)
         slope_before = norm2(self%last%unknowns(:n) - self%before(:n))/abs(p - self%before_value)
         has_jumped = is_far_above(slope, slope_before, slope_before)
      end associate
   end function has_jumped
end module hb_neighbour
