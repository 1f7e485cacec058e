!> The branches of a curve: the first one, those that leave it at branch points, and those of separate motions. Each is followed
!> from its origin in one direction or in both.
module hb_curve_branches
   use hb_curve_request, only: curve_request_t
   use hb_kinds, only: wp
   use hb_level, only: level_t
   use hb_thresholds, only: negligible_share
   implicit none
   private
   public :: branches_t, origin_t

   !> A motion with the direction of a curve there.
   type :: origin_t
      logical :: is_apart = .false. !! separate from the previous curves; otherwise an intersection with another curve
      logical :: is_traced = .false.                                  !! another branch has come here: this one is the same
      real(wp), allocatable :: x(:)                                   !! as stored, `pack` of hb_followed
      real(wp), allocatable :: direction(:)                           !! likewise
      type(level_t) :: level                                          !! set and grid of both
   end type origin_t

   !> All branches, and the present one.
   type :: branches_t
      type(origin_t) :: first                                         !! of the first branch; a direction if it leaves another curve
      type(origin_t), allocatable :: origins(:)                       !! of all others
      type(origin_t), allocatable :: coexisting(:)                    !! motions passed at values at which others are searched for
      integer :: number = 0                                           !! origin of the present branch; 0: the first one
      logical :: is_reversed = .false.                                !! it is the second of the two from its origin
      type(origin_t) :: start                                         !! of the present branch, its unknowns unpacked
      type(origin_t) :: start_on_set                                  !! the same on the present set
      real(wp) :: first_sense = 1.0_wp                                !! of the value along the first branch
   contains
      procedure :: begin => branches_begin
      procedure :: add => branches_add
      procedure :: note => branches_note
      procedure :: trace => branches_trace
      procedure :: advance => branches_advance
      procedure :: are_exhausted => branches_are_exhausted
      procedure :: origin => branches_origin
      procedure :: direction => branches_direction
      procedure :: leaves_another => branches_leaves_another
      procedure :: sense => branches_sense
   end type branches_t

contains

   !> Begins with the first branch alone.
   subroutine branches_begin(self, first, request)
      class(branches_t), intent(out) :: self
      type(origin_t), intent(in) :: first
      type(curve_request_t), intent(in) :: request

      self%first = first
      self%origins = [origin_t ::]
      self%coexisting = [origin_t ::]
      self%first_sense = sign(1.0_wp, request%to - request%start)
      if (.not. abs(request%to - request%start) > 0.0_wp) self%first_sense = sign(1.0_wp, request%from - request%to)
   end subroutine branches_begin

   !> Adds a branch that begins at a branch point or, without a direction, at a separate motion.
   subroutine branches_add(self, x, level, direction)
      class(branches_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      type(level_t), intent(in) :: level
      real(wp), intent(in), optional :: direction(:)

      call append(self%origins, x, level)
      associate (origin => self%origins(size(self%origins)))
         origin%is_apart = .not. present(direction)
         if (present(direction)) origin%direction = direction
      end associate
   end subroutine branches_add

   !> Notes a motion if others are searched for at its value.
   subroutine branches_note(self, x, level, request)
      class(branches_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      type(level_t), intent(in) :: level                              !! its set and grid
      type(curve_request_t), intent(in) :: request

      if (.not. allocated(request%others)) return
      if (all(abs(request%others - x(size(x))) > 0.0_wp)) return
      call append(self%coexisting, x, level)
   end subroutine branches_note

   !> (gfortran 12 leaks the components of a structure constructor within an array constructor.)
   subroutine append(list, x, level)
      type(origin_t), allocatable, intent(inout) :: list(:)
      real(wp), intent(in) :: x(:)
      type(level_t), intent(in) :: level
      type(origin_t) :: origin

      origin%x = x
      origin%direction = 0.0_wp*x
      origin%level = level
      list = [list, origin]
   end subroutine append

   !> Notes that a branch has come to a point: one that begins there is the same.
   subroutine branches_trace(self, x, branch, typical)
      class(branches_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! as stored
      integer, intent(in) :: branch                                   !! that has come there
      real(wp), intent(in) :: typical                                 !! change of the value
      integer :: i, n

      n = size(x)
      do i = 1, size(self%origins)
         associate (origin => self%origins(i)%x)
            if (self%origins(i)%is_apart .or. i == branch) cycle
            if (abs(origin(size(origin)) - x(n)) > negligible_share*typical) cycle
            self%origins(i)%is_traced = self%origins(i)%is_traced .or. &
               abs(norm2(origin(:size(origin) - 1)) - norm2(x(:n - 1))) <= negligible_share*norm2(origin(:size(origin) - 1))
         end associate
      end do
   end subroutine branches_trace

   !> Goes on to the other branch from the same origin, unless this is the last one, or to the next origin that no branch has
   !> come to.
   subroutine branches_advance(self, is_last)
      class(branches_t), intent(inout) :: self
      logical, intent(in) :: is_last                                  !! from this origin

      self%is_reversed = .not. (self%is_reversed .or. is_last)
      if (.not. self%is_reversed) self%number = self%number + 1
      do while (self%number > 0 .and. self%number <= size(self%origins))
         if (.not. self%origins(self%number)%is_traced) exit
         self%number = self%number + 1
      end do
   end subroutine branches_advance

   !> Whether there is no branch left.
   pure logical function branches_are_exhausted(self) result(are_exhausted)
      class(branches_t), intent(in) :: self

      are_exhausted = self%number > size(self%origins)
   end function branches_are_exhausted

   !> The origin of the present branch, as stored.
   pure type(origin_t) function branches_origin(self) result(origin)
      class(branches_t), intent(in) :: self

      if (self%number == 0) then
         origin = self%first
      else
         origin = self%origins(self%number)
      end if
   end function branches_origin

   !> The direction in which the present branch begins, of the curve that is left at a branch point.
   pure function branches_direction(self) result(direction)
      class(branches_t), intent(in) :: self
      real(wp), allocatable :: direction(:)

      if ((self%number == 0 .and. allocated(self%first%direction)) .or. self%leaves_another()) then
         direction = self%start%direction
      else
         direction = 0.0_wp*self%start%x
         direction(size(direction)) = self%first_sense*self%sense()
      end if
   end function branches_direction

   !> Whether the present branch begins at a branch point.
   pure logical function branches_leaves_another(self) result(leaves)
      class(branches_t), intent(in) :: self

      leaves = self%number > 0
      if (leaves) leaves = .not. self%origins(self%number)%is_apart
   end function branches_leaves_another

   !> 1 on the first of two branches from one point, -1 on the other.
   pure real(wp) function branches_sense(self) result(sense)
      class(branches_t), intent(in) :: self

      sense = merge(-1.0_wp, 1.0_wp, self%is_reversed)
   end function branches_sense
end module hb_curve_branches
