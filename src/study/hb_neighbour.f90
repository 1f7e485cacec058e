!> First guesses from neighbours: each point of a chain along a swept parameter starts from the solutions of the points
!> before it, never from a point of another chain, so that nothing depends on who solves which chain and when.
module hb_neighbour
   use hb_kinds, only: wp
   implicit none
   private
   public :: neighbour_t

   !> The last two solutions of a chain.
   type :: neighbour_t
      private
      integer :: n_kept = 0
      integer, allocatable :: tuples(:, :)
      real(wp), allocatable :: last(:), before(:)
      real(wp) :: last_value = 0.0_wp, before_value = 0.0_wp
   contains
      procedure :: forget => neighbour_forget
      procedure :: keep => neighbour_keep
      procedure :: predict => neighbour_predict
   end type neighbour_t

contains

   !> Forgets all solutions: a new chain begins, or a point was not solved.
   pure subroutine neighbour_forget(self)
      class(neighbour_t), intent(inout) :: self

      self%n_kept = 0
   end subroutine neighbour_forget

   !> Keeps the solution of the point just solved; with other harmonics than before, it alone.
   pure subroutine neighbour_keep(self, parameter, tuples, unknowns)
      class(neighbour_t), intent(inout) :: self
      real(wp), intent(in) :: parameter                               !! its value at the point, in the unit of the input
      integer, intent(in) :: tuples(:, :)                             !! harmonics of the point, (n_tones, n_harmonics)
      real(wp), intent(in) :: unknowns(:)

      if (.not. is_alike(self, tuples, size(unknowns))) self%n_kept = 0
      if (self%n_kept > 0) then
         self%before = self%last
         self%before_value = self%last_value
      end if
      self%tuples = tuples
      self%last = unknowns
      self%last_value = parameter
      self%n_kept = min(2, self%n_kept + 1)
   end subroutine neighbour_keep

   !> Gives a first guess for the next point, unallocated where there is no neighbour with the same harmonics: the last
   !> solution x1, or with two of them the line x1 + (x1 - x0) (p - p1)/(p1 - p0) through both.
   pure subroutine neighbour_predict(self, parameter, tuples, secant, start)
      class(neighbour_t), intent(in) :: self
      real(wp), intent(in) :: parameter
      integer, intent(in) :: tuples(:, :)
      logical, intent(in) :: secant                                   !! false: the last solution as it is
      real(wp), allocatable, intent(out) :: start(:)

      if (self%n_kept == 0) return
      if (any(shape(tuples) /= shape(self%tuples))) return
      if (any(tuples /= self%tuples)) return
      start = self%last
      if (.not. secant .or. self%n_kept < 2) return
      if (.not. abs(self%last_value - self%before_value) > 0.0_wp) return
      start = start + (self%last - self%before)*((parameter - self%last_value)/(self%last_value - self%before_value))
   end subroutine neighbour_predict

   pure logical function is_alike(self, tuples, n_unknowns)
      type(neighbour_t), intent(in) :: self
      integer, intent(in) :: tuples(:, :), n_unknowns

      is_alike = .false.
      if (self%n_kept == 0) return
      if (any(shape(tuples) /= shape(self%tuples)) .or. size(self%last) /= n_unknowns) return
      is_alike = all(tuples == self%tuples)
   end function is_alike
end module hb_neighbour
