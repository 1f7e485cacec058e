!> First guesses from neighbours: each point of a chain along a swept parameter starts from the solutions of the points
!> before it, never from a point of another chain, so that nothing depends on which rank solves which chain and when.
module hb_neighbour
   use hb_basis, only: transfer_coefficients
   use hb_branches, only: is_far_above
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_kinds, only: wp
   use hb_level, only: level_t
   use hb_model, only: model_t
   implicit none
   private
   public :: neighbour_t

   real(wp), parameter :: farthest = 4.0_wp                           ! that a line is trusted, in steps between its points

   !> The last two solutions of a chain.
   type :: neighbour_t
      private
      integer :: n_kept = 0
      integer, allocatable :: tuples(:, :)
      integer, allocatable :: n_samples(:)                            ! of the grid of the last one, where points choose theirs
      real(wp), allocatable :: last(:), before(:)
      real(wp) :: last_value = 0.0_wp, before_value = 0.0_wp
   contains
      procedure :: forget => neighbour_forget
      procedure :: keep => neighbour_keep
      procedure :: predict => neighbour_predict
      procedure :: predict_level => neighbour_predict_level
   end type neighbour_t

contains

   !> Forgets all solutions: a new chain begins, or a point was not solved.
   pure subroutine neighbour_forget(self)
      class(neighbour_t), intent(inout) :: self

      self%n_kept = 0
   end subroutine neighbour_forget

   !> Keeps the solution of the point just solved; it alone, with other harmonics than before and where it has jumped away from
   !> those before: a line through two branches leads nowhere.
   pure subroutine neighbour_keep(self, parameter, tuples, unknowns, n_samples)
      class(neighbour_t), intent(inout) :: self
      real(wp), intent(in) :: parameter                               !! its value at the point, in the unit of the input
      integer, intent(in) :: tuples(:, :)                             !! harmonics of the point, (n_tones, n_harmonics)
      real(wp), intent(in) :: unknowns(:)
      integer, intent(in), optional :: n_samples(:)                   !! of its grid, where points choose theirs

      if (present(n_samples)) self%n_samples = n_samples
      if (.not. is_alike(self, tuples, size(unknowns))) self%n_kept = 0
      if (self%n_kept == 2) then
         if (has_jumped(self, parameter, unknowns)) self%n_kept = 0
      end if
      if (self%n_kept > 0) then
         self%before = self%last
         self%before_value = self%last_value
      end if
      self%tuples = tuples
      self%last = unknowns
      self%last_value = parameter
      self%n_kept = min(2, self%n_kept + 1)
   end subroutine neighbour_keep

   !> Gives a first guess for the next point, unallocated where there is no neighbour: the last solution x1, or with two of them of
   !> the same harmonics the line x1 + (x1 - x0) (p - p1)/(p1 - p0) through both. Harmonics that the last one lacks are zero.
   subroutine neighbour_predict(self, parameter, tuples, secant, start)
      class(neighbour_t), intent(in) :: self
      real(wp), intent(in) :: parameter
      integer, intent(in) :: tuples(:, :)
      logical, intent(in) :: secant                                   !! false: the last solution as it is
      real(wp), allocatable, intent(out) :: start(:)

      if (self%n_kept == 0) return
      if (.not. are_same(tuples, self%tuples)) then
         start = on_other_harmonics(self, tuples)
         return
      end if
      start = self%last
      if (.not. secant .or. self%n_kept < 2) return
      if (.not. abs(parameter - self%last_value) <= farthest*abs(self%last_value - self%before_value)) return
      start = start + (self%last - self%before)*((parameter - self%last_value)/(self%last_value - self%before_value))
   end subroutine neighbour_predict

   !> Gives the set and the grid of the last point with a first guess in them, where the model wants first guesses from neighbours
   !> and there is one; neighbours share sets as long as these serve them.
   subroutine neighbour_predict_level(self, parameter, model, level)
      class(neighbour_t), intent(in) :: self
      real(wp), intent(in) :: parameter
      type(model_t), intent(in) :: model
      type(level_t), intent(out) :: level
      type(error_t), allocatable :: error

      if (.not. model%chain%is_on .or. self%n_kept == 0) return
      call self%predict(parameter, self%tuples, model%chain%secant, level%unknowns)
      call new_harmonics(level%set, self%tuples, error)               ! cannot fail: there was a solution in it
      if (allocated(self%n_samples)) level%n_samples = self%n_samples
   end subroutine neighbour_predict_level

   !> Whether the motion has left the way of the points before, as far as these tell.
   pure logical function has_jumped(self, parameter, unknowns)
      type(neighbour_t), intent(in) :: self
      real(wp), intent(in) :: parameter, unknowns(:)
      real(wp) :: slope, slope_before

      has_jumped = .false.
      associate (n => size(unknowns) - size(self%tuples, 1), p => self%last_value)        ! base frequencies follow the coefficients
         if (.not. (abs(parameter - p) > 0.0_wp .and. abs(p - self%before_value) > 0.0_wp)) return
         slope = norm2(unknowns(:n) - self%last(:n))/abs(parameter - p)
         slope_before = norm2(self%last(:n) - self%before(:n))/abs(p - self%before_value)
         has_jumped = is_far_above(slope, slope_before, slope_before)
      end associate
   end function has_jumped

   pure logical function is_alike(self, tuples, n_unknowns)
      type(neighbour_t), intent(in) :: self
      integer, intent(in) :: tuples(:, :), n_unknowns

      is_alike = .false.
      if (self%n_kept == 0) return
      is_alike = size(self%last) == n_unknowns .and. are_same(tuples, self%tuples)
   end function is_alike

   pure logical function are_same(tuples, others)
      integer, intent(in) :: tuples(:, :), others(:, :)

      are_same = all(shape(tuples) == shape(others))
      if (are_same) are_same = all(tuples == others)
   end function are_same

   !> The last solution in other harmonics, zero in those that it lacks; the base frequencies follow.
   function on_other_harmonics(self, tuples) result(start)
      type(neighbour_t), intent(in) :: self
      integer, intent(in) :: tuples(:, :)
      real(wp), allocatable :: start(:)
      type(harmonics_t) :: from_set, to_set
      type(error_t), allocatable :: error
      real(wp), allocatable :: u(:, :)
      integer :: n, n_dofs

      call new_harmonics(from_set, self%tuples, error)                ! cannot fail: there was a solution in it,
      if (.not. allocated(error)) call new_harmonics(to_set, tuples, error)   ! and there is a model with it
      n = size(self%last) - size(tuples, 1)
      n_dofs = n/from_set%n_coefficients
      allocate (u(to_set%n_coefficients, n_dofs))
      call transfer_coefficients(from_set, to_set, reshape(self%last(:n), [from_set%n_coefficients, n_dofs]), u)
      start = [u, self%last(n + 1:)]
   end function on_other_harmonics
end module hb_neighbour
