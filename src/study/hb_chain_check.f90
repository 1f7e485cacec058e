!> Whether the points of a chain lie on one branch of motions. Where a point is not where those before it lead, the branch of the
!> last one is followed up to it in small steps, hb_branch_tracking; what is found becomes the message of the point.
!>
!> The work is bounded: that of all motions in between by the work of the points of the chain so far and a part of a second.
module hb_chain_check
   use hb_branch_tracking, only: difference_of, find_branch, finding, smallest_jump, stretch_t, tracking_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_motion, only: solve_motion
   use hb_motion_result, only: motion_result_t
   use hb_point_source, only: point_source_t
   use hb_scene, only: scene_t
   use hb_scene_reader, only: update_scene
   use hb_stability, only: stability_method
   use hb_watch, only: verdict, watch_t
   implicit none
   private
   public :: chain_check_t

   integer, parameter :: most_motions = 120                           ! to be sought for a point
   real(wp), parameter :: free_work = 0.03e9_wp                       ! of a chain, as `work` of a result
   integer, parameter :: most_iterations = 10                         ! for one, from a guess that is close to it
   real(wp), parameter :: largest_turn = 0.5_wp                       ! of a step that nobody doubts, relative to its length
   real(wp), parameter :: largest_first = 0.2_wp                      ! first step of a chain, relative to the motion

   !> The solved points of a chain so far.
   type :: chain_check_t
      private
      integer :: last_point = 0                                       ! 0: none
      real(wp) :: work_left = free_work
      real(wp) :: last_value = 0.0_wp
      integer, allocatable :: tuples(:, :)
      real(wp), allocatable :: last(:), slope(:)                      ! coefficients; slope not allocated: not known
   contains
      procedure :: look => chain_check_look
   end type chain_check_t

   !> Between two points of a sweep.
   type, extends(stretch_t) :: swept_stretch_t
      type(point_source_t), pointer :: source => null()
      class(watch_t), pointer :: watch => null()
      integer :: first = 0, last = 0                                  ! points
      integer :: n_left = most_motions
      real(wp) :: work_left = 0.0_wp
      real(wp), allocatable :: frequencies(:)                         ! behind the coefficients of a guess
   contains
      procedure :: solve => swept_stretch_solve
   end type swept_stretch_t

contains

   !> Looks at a solved point, which follows the last one that was looked at. The document and the scene may have values between
   !> the two afterwards.
   subroutine chain_check_look(self, source, point, unknowns, result, watch)
      class(chain_check_t), intent(inout) :: self
      type(point_source_t), intent(inout), target :: source
      integer, intent(in) :: point
      real(wp), intent(in) :: unknowns(:)                             !! of the point: coefficients, then base frequencies
      type(motion_result_t), intent(inout) :: result                  !! of the point; gets the message
      class(watch_t), intent(inout), target :: watch
      type(swept_stretch_t) :: stretch
      type(tracking_t) :: tracking
      real(wp), allocatable :: motion(:)
      real(wp) :: length

      motion = unknowns(:size(unknowns) - source%scene%tones%n_tones)
      self%work_left = self%work_left + result%work
      if (is_alike()) then
         length = source%plan%fastest_value(point) - self%last_value
         if (is_doubtful(self, motion, length) .and. self%work_left > 0.0_wp) then
            stretch%source => source
            stretch%watch => watch
            stretch%first = self%last_point
            stretch%last = point
            stretch%frequencies = unknowns(size(motion) + 1:)
            stretch%work_left = self%work_left
            call find_branch(stretch, self%last, motion, tracking)
            self%work_left = stretch%work_left
            call tell(tracking, source%plan%describe_between(self%last_point, point, tracking%share), result)
         end if
         if (result%leaves_branch) then
            if (allocated(self%slope)) deallocate (self%slope)
         else
            self%slope = (motion - self%last)/length
         end if
      else if (allocated(self%slope)) then
         deallocate (self%slope)
      end if
      self%tuples = source%scene%harmonics%tuples
      self%last = motion
      self%last_value = source%plan%fastest_value(point)
      self%last_point = point

   contains

      logical function is_alike()
         is_alike = .false.
         if (self%last_point == 0) return
         associate (tuples => source%scene%harmonics%tuples)
            if (any(shape(self%tuples) /= shape(tuples)) .or. size(self%last) /= size(motion)) return
            is_alike = all(self%tuples == tuples)
         end associate
      end function is_alike
   end subroutine chain_check_look

   !> Whether a point is not where those before it lead.
   pure logical function is_doubtful(self, motion, length)
      type(chain_check_t), intent(in) :: self
      real(wp), intent(in) :: motion(:)
      real(wp), intent(in) :: length                                  !! of the step in the parameter

      is_doubtful = difference_of(motion, self%last) > smallest_jump
      if (.not. is_doubtful) return
      if (allocated(self%slope)) then
         is_doubtful = norm2(motion - self%last - length*self%slope) > largest_turn*norm2(motion - self%last)
      else
         is_doubtful = difference_of(motion, self%last) > largest_first
      end if
   end function is_doubtful

   !> Says what was found, if there is something to say.
   subroutine tell(tracking, place, result)
      type(tracking_t), intent(in) :: tracking
      character(*), intent(in) :: place                               !! where the tracking was left
      type(motion_result_t), intent(inout) :: result
      character(:), allocatable :: text

      select case (tracking%finding)
      case (finding%ends)
         text = "another branch of motions than at the point before, whose branch ends near "//place
      case (finding%goes_on)
         text = "another branch of motions than at the point before, whose branch goes on here with another motion"
      case default
         return
      end select
      result%leaves_branch = .true.
      if (allocated(result%message)) then
         if (len(result%message) > 0) text = result%message//"; "//text
      end if
      result%message = text
   end subroutine tell

   !> Finds the motion of the scene between two points, and no more than it.
   subroutine swept_stretch_solve(self, share, motion, is_solved)
      class(swept_stretch_t), intent(inout) :: self
      real(wp), intent(in) :: share
      real(wp), intent(inout) :: motion(:)
      logical, intent(out) :: is_solved
      type(error_t), allocatable :: error
      type(motion_result_t) :: result
      type(scene_t) :: bare
      real(wp), allocatable :: guess(:), unknowns(:)
      logical :: is_new

      is_solved = .false.
      call self%source%plan%apply_between(self%first, self%last, share, self%source%document)
      call update_scene(self%source%scene, self%source%document, is_new, error, self%source%available_memory)
      if (allocated(error)) return
      bare = self%source%scene
      bare%solver%rescue = .false.
      bare%solver%max_iterations = min(most_iterations, bare%solver%max_iterations)
      bare%certificate%is_on = .false.
      bare%stability%method = stability_method%off
      bare%output%samples = [integer ::]
      guess = [motion, self%frequencies]
      call solve_motion(bare, result, error, guess, unknowns, self%watch)
      self%n_left = self%n_left - 1
      self%work_left = self%work_left - result%work
      self%is_spent = self%n_left == 0 .or. self%work_left <= 0.0_wp .or. self%watch%verdict /= verdict%go_on
      if (allocated(error) .or. .not. allocated(unknowns)) return
      motion = unknowns(:size(motion))
      is_solved = .true.
   end subroutine swept_stretch_solve
end module hb_chain_check
