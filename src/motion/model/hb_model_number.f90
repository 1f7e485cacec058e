!> A number of a model: the object that has it, its key and indices there, and its range; and ties, by which numbers
!> follow others.
module hb_model_number
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_element_catalogue, only: element_groups
   use hb_kinds, only: wp
   use hb_load_catalogue, only: load_groups
   use hb_numbers, only: number_t
   use hb_text, only: max_name, to_text
   implicit none
   private
   public :: follower_t, followers_of, followers_of_changes, has_number, model_number_t, moving_groups, moving_value_t, &
      numbered_groups, relation_t, tie_t, values_at

   integer, parameter :: n_elements = size(element_groups), n_loads = size(load_groups)

   !> The objects of a model that have numbers.
   type :: has_number_t
      integer :: none = 0
      integer :: structure = 1
      integer :: element = 2                                          !! those of the catalogue, in its order
      integer :: dynamic_stiffness = n_elements + 2
      integer :: tones = n_elements + 3
      integer :: load = n_elements + 4                                !! as elements
      integer :: start = n_elements + n_loads + 4
      integer :: law = n_elements + n_loads + 5
      integer :: normal_mode = n_elements + n_loads + 6
   end type has_number_t
   type(has_number_t), parameter :: has_number = has_number_t()

   !> The same objects by the groups of an input.
   type :: numbered_group_t
      character(max_name) :: name
      logical :: is_of_structure = .false.                            !! the matrices of the structure depend on its numbers
      logical :: is_of_loads = .false.                                !! the loads depend on them
      logical :: may_move = .true.                                    !! they may move along curves: they change the motion
      logical :: may_follow_unknown = .false.                         !! they may follow the frequency of an unknown tone
   end type numbered_group_t
   integer :: k                                                       ! of the table alone
   type(numbered_group_t), parameter :: numbered_groups(*) = [ &
      numbered_group_t("structure", is_of_structure=.true., may_follow_unknown=.true.), &
      (numbered_group_t(element_groups(k), is_of_structure=.true., may_follow_unknown=.true.), k=1, n_elements), &
      numbered_group_t("dynamic_stiffness", is_of_structure=.true.), &
      numbered_group_t("tones"), &
      (numbered_group_t(load_groups(k), is_of_loads=.true., may_follow_unknown=.true.), k=1, n_loads), &
      numbered_group_t("start", may_move=.false.), &                  ! it selects a motion
      numbered_group_t("law", may_follow_unknown=.true.), &
      numbered_group_t("normal_mode", may_move=.false.)]              ! its amplitude or energy alone, which an equation has
   character(*), parameter :: moving_groups(*) = pack(numbered_groups%name, numbered_groups%may_move)

   type, extends(number_t) :: model_number_t
      integer :: object = has_number%none                             !! one of `has_number`
      integer :: i = 1                                                !! number among the objects of this kind, as given
      real(wp) :: minimum = -huge(1.0_wp), maximum = huge(1.0_wp)     !! inclusive limits
      real(wp) :: above = -huge(1.0_wp)                               !! exclusive limit
      character(64) :: name = ""                                      !! for messages
   contains
      procedure :: range_problem => model_number_range_problem
      procedure :: includes => model_number_includes
      procedure :: is_of_structure => model_number_is_of_structure
      procedure :: is_of_loads => model_number_is_of_loads
   end type model_number_t

   !> A number of a model that moves.
   type :: moving_value_t
      type(model_number_t) :: number
      real(wp) :: typical = 1.0_wp                                    !! > 0, such as the length of its range
      logical :: is_tied = .false.                                    !! of a tone: all others keep their ratios to it
   end type moving_value_t

   !> How a number follows another one: offset + factor times the other.
   type :: relation_t
      real(wp) :: factor = 1.0_wp
      real(wp) :: offset = 0.0_wp
   contains
      procedure :: at => relation_at
   end type relation_t

   !> A number that follows another one.
   type :: tie_t
      type(model_number_t) :: number                                  !! the one that follows; without an object: a setting
      type(model_number_t) :: to                                      !! the one that is followed, likewise
      type(relation_t) :: relation
   end type tie_t

   !> One of the numbers that move with a value.
   type :: follower_t
      type(model_number_t) :: number
      type(relation_t) :: relation
      real(wp) :: slope = 1.0_wp                                      !! derivative by the value
      integer :: source = 0                                           !! index of the follower that it follows; 0: the value
      integer :: tie = 0                                              !! number of the tie by which it does
   end type follower_t

contains

   !> The number that follows.
   elemental real(wp) function relation_at(self, value)
      class(relation_t), intent(in) :: self
      real(wp), intent(in) :: value                                   !! of the one that is followed

      relation_at = self%offset + self%factor*value
   end function relation_at

   !> Why a value is outside of the range; empty if it is inside.
   pure function model_number_range_problem(self, value) result(text)
      class(model_number_t), intent(in) :: self
      real(wp), intent(in) :: value
      character(120) :: text

      text = ""
      if (.not. ieee_is_finite(value)) then
         text = "must be finite"
      else if (value < self%minimum) then
         text = "must be "//to_text(self%minimum)//" or greater"
      else if (value > self%maximum) then
         text = "must be "//to_text(self%maximum)//" or less"
      else if (value <= self%above) then
         text = "must be above "//to_text(self%above)
      end if
      if (text /= "") text = trim(self%name)//" = "//to_text(value)//" "//trim(text)
   end function model_number_range_problem

   !> Whether the matrices of the structure depend on the number.
   elemental logical function model_number_is_of_structure(self) result(is_of_structure)
      class(model_number_t), intent(in) :: self

      is_of_structure = .false.
      if (self%object /= has_number%none) is_of_structure = numbered_groups(self%object)%is_of_structure
   end function model_number_is_of_structure

   !> Whether the loads depend on the number, whatever the structure.
   elemental logical function model_number_is_of_loads(self) result(is_of_loads)
      class(model_number_t), intent(in) :: self

      is_of_loads = .false.
      if (self%object /= has_number%none) is_of_loads = numbered_groups(self%object)%is_of_loads
   end function model_number_is_of_loads

   !> Whether another number is this one, or an element of this list; a list without an index is followed by its first
   !> element.
   pure logical function model_number_includes(self, other) result(includes)
      class(model_number_t), intent(in) :: self
      type(model_number_t), intent(in) :: other

      includes = self%object == other%object .and. self%i == other%i .and. self%key == other%key
      if (self%object == has_number%none) includes = .false.
      if (includes) includes = all(self%element == 0) .or. all(self%element == other%element) .or. &
                               (all(other%element == 0) .and. all(self%element == [1, 0]))
   end function model_number_includes

   !> The numbers that move with the first ones by ties, after these.
   pure function followers_of(ties, first) result(followers)
      type(tie_t), intent(in) :: ties(:)                              !! in their order
      type(follower_t), intent(in) :: first(:)                        !! the value itself, and others that it moves
      type(follower_t), allocatable :: followers(:)
      integer :: i, k

      followers = first
      do i = 1, size(ties)
         do k = 1, size(followers)
            if (.not. followers(k)%number%includes(ties(i)%to)) cycle
            followers = [followers, follower_t(ties(i)%number, ties(i)%relation, ties(i)%relation%factor*followers(k)%slope, &
                                               source=k, tie=i)]
            exit
         end do
      end do
   end function followers_of

   !> Numbers that have changed, and those that follow them, whatever the value.
   pure function followers_of_changes(ties, numbers, values) result(followers)
      type(tie_t), intent(in) :: ties(:)                              !! in their order
      type(model_number_t), intent(in) :: numbers(:)                  !! with an object
      real(wp), intent(in) :: values(:)                               !! of these numbers
      type(follower_t), allocatable :: followers(:)
      integer :: i

      followers = followers_of(ties, [(follower_t(numbers(i), relation_t(0.0_wp, values(i)), 0.0_wp), i=1, size(numbers))])
   end function followers_of_changes

   !> The numbers at a value.
   pure function values_at(followers, value) result(values)
      type(follower_t), intent(in) :: followers(:)
      real(wp), intent(in) :: value
      real(wp) :: values(size(followers))
      integer :: i

      do i = 1, size(followers)
         if (followers(i)%source > 0) then
            values(i) = followers(i)%relation%at(values(followers(i)%source))
         else
            values(i) = followers(i)%relation%at(value)
         end if
      end do
   end function values_at
end module hb_model_number
