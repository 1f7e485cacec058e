!> The real numbers of an object, such as the stiffness and the gap of a law.
!>
!> An object declares each of its numbers once, by the key that an input has for it:
!>
!>     call numbers%add("stiffness", self%stiffness)
!>     call numbers%add("gap", self%gap)
!>
!> What is done with a declared number depends on `numbers`: it is read from a group (hb_number_reader), set, found or
!> listed. Whatever else depends on the numbers follows from them in `derive`. To set a number is therefore a store and
!> a call of `derive`. A number is identified by its key and its indices, not by an address, so that it is valid for
!> copies of the object. Integers, logicals and choices are declared likewise; they are read, but never set one by one.
module hb_numbers
   use hb_kinds, only: wp
   use hb_text, only: max_name
   implicit none
   private
   public :: number_t, numbered_t, numbers_t

   !> One number of an object.
   type :: number_t
      character(max_name) :: key = ""                       !! lower case
      integer :: element(2) = 0                             !! indices in a list or a matrix, 0 where there is none
   end type number_t

   !> What is done with the numbers that an object declares.
   type, abstract :: numbers_t
   contains
      generic :: add => add_number, add_list, add_matrix, add_integer, add_integers, add_logical
      procedure(add_number), deferred :: add_number
      procedure(add_list), deferred :: add_list
      procedure(add_matrix), deferred :: add_matrix
      procedure :: add_integer => numbers_add_integer
      procedure :: add_integers => numbers_add_integers
      procedure :: add_logical => numbers_add_logical
      procedure :: note_given => numbers_note_given
      procedure :: reject => numbers_reject
   end type numbers_t

   abstract interface
      !> Declares a single number.
      subroutine add_number(self, key, value, required, unit)
         import :: numbers_t, wp
         class(numbers_t), intent(inout) :: self
         character(*), intent(in) :: key                    !! lower case
         real(wp), intent(inout) :: value
         logical, intent(in), optional :: required          !! whether an input must give it, if the table of keys does not decide
         character(*), intent(in), optional :: unit         !! likewise
      end subroutine add_number

      !> Declares a list of numbers.
      subroutine add_list(self, key, values, n, required)
         import :: numbers_t, wp
         class(numbers_t), intent(inout) :: self
         character(*), intent(in) :: key
         real(wp), allocatable, intent(inout) :: values(:)
         integer, intent(in), optional :: n                 !! its length, if an input must give so many
         logical, intent(in), optional :: required          !! likewise
      end subroutine add_list

      !> Declares a matrix, `n` by `m` in an input.
      subroutine add_matrix(self, key, values, n, m, required)
         import :: numbers_t, wp
         class(numbers_t), intent(inout) :: self
         character(*), intent(in) :: key
         real(wp), allocatable, intent(inout) :: values(:, :)
         integer, intent(in) :: n, m
         logical, intent(in), optional :: required          !! likewise
      end subroutine add_matrix
   end interface

   !> An object that has numbers.
   type, abstract :: numbered_t
   contains
      procedure :: declare_numbers => numbered_declare_numbers
      procedure :: declare_inherited => numbered_declare_inherited
      procedure :: derive_inherited => numbered_derive_inherited
      procedure :: derive => numbered_derive
      procedure :: has_valid_numbers => numbered_has_valid_numbers
      procedure :: is_affine_in => numbered_is_affine_in
      procedure, non_overridable :: set_number => numbered_set_number
      procedure, non_overridable :: set_numbers => numbered_set_numbers
      procedure, non_overridable :: find_number => numbered_find_number
      procedure, non_overridable :: list_numbers => numbered_list_numbers
   end type numbered_t

   !> Finds one number, and sets it if requested.
   type, extends(numbers_t) :: access_t
      type(number_t) :: number
      logical :: sets = .false.
      real(wp) :: value = 0.0_wp                            !! that is set, or found
      logical :: is_found = .false.
   contains
      procedure :: add_number => access_add_number
      procedure :: add_list => access_add_list
      procedure :: add_matrix => access_add_matrix
   end type access_t

   !> Lists the numbers, element by element.
   type, extends(numbers_t) :: list_t
      type(number_t), allocatable :: found(:)
   contains
      procedure :: add_number => list_add_number
      procedure :: add_list => list_add_list
      procedure :: add_matrix => list_add_matrix
   end type list_t

contains

   !> Declares an integer.
   subroutine numbers_add_integer(self, key, value)
      class(numbers_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(inout) :: value
   end subroutine numbers_add_integer

   !> Declares a list of integers.
   subroutine numbers_add_integers(self, key, values)
      class(numbers_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, allocatable, intent(inout) :: values(:)
   end subroutine numbers_add_integers

   !> Declares a logical, or whether a choice is `word`.
   subroutine numbers_add_logical(self, key, value, word)
      class(numbers_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: value
      character(*), intent(in), optional :: word
   end subroutine numbers_add_logical

   !> Declares whether an input gives a key, where this decides what else it gives.
   subroutine numbers_note_given(self, key, is_given)
      class(numbers_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: is_given
   end subroutine numbers_note_given

   !> Declares that an input must not give a key; `text` is the reason.
   subroutine numbers_reject(self, key, text)
      class(numbers_t), intent(inout) :: self
      character(*), intent(in) :: key, text
   end subroutine numbers_reject

   !> Declares the numbers of the object to `numbers`; without an override it has none.
   subroutine numbered_declare_numbers(self, numbers)
      class(numbered_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers
   end subroutine numbered_declare_numbers

   !> Declares the numbers of a parent type, which are not read with the others; without an override it has none.
   subroutine numbered_declare_inherited(self, numbers)
      class(numbered_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers
   end subroutine numbered_declare_inherited

   !> Computes all components that follow from these, after one of them was set.
   pure subroutine numbered_derive_inherited(self)
      class(numbered_t), intent(inout) :: self
   end subroutine numbered_derive_inherited

   !> Computes all components that follow from the numbers; without an override there are none.
   pure subroutine numbered_derive(self)
      class(numbered_t), intent(inout) :: self
   end subroutine numbered_derive

   !> Whether the numbers, each of which is in its range, fit together.
   logical function numbered_has_valid_numbers(self) result(are_valid)
      class(numbered_t), intent(in) :: self

      are_valid = .true.
   end function numbered_has_valid_numbers

   !> Whether structure and loads are affine functions of a number, a + b p: differences of any length are then exact, and long
   !> ones are formed. Not assumed: an object overrides this for such numbers.
   pure logical function numbered_is_affine_in(self, number) result(is_affine)
      class(numbered_t), intent(in) :: self
      type(number_t), intent(in) :: number                  !! one that it declares

      is_affine = .false.
   end function numbered_is_affine_in

   !> Sets a number and what follows from it, as `set_numbers` does.
   subroutine numbered_set_number(self, number, value, is_set)
      class(numbered_t), intent(inout) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in) :: value
      logical, intent(out) :: is_set

      call self%set_numbers([number], [value], is_set)
   end subroutine numbered_set_number

   !> Sets numbers and what follows from them. `are_set` is false if the object does not have one of them, or if they do not
   !> fit to each other; the object must then not be used.
   subroutine numbered_set_numbers(self, numbers, values, are_set)
      class(numbered_t), intent(inout) :: self
      type(number_t), intent(in) :: numbers(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: are_set
      type(access_t) :: access
      integer :: i

      access%sets = .true.
      do i = 1, size(numbers)
         access%number = numbers(i)
         access%value = values(i)
         access%is_found = .false.
         call self%declare_numbers(access)
         if (.not. access%is_found) then
            call self%declare_inherited(access)
            if (access%is_found) call self%derive_inherited()
         end if
         are_set = access%is_found
         if (.not. are_set) return
      end do
      are_set = self%has_valid_numbers()
      if (are_set) call self%derive()
      if (are_set) are_set = self%has_valid_numbers()       ! some problems are found only here
   end subroutine numbered_set_numbers

   !> Finds the value of a number.
   subroutine numbered_find_number(self, number, value, is_found)
      class(numbered_t), intent(inout) :: self              !! unchanged
      type(number_t), intent(in) :: number
      real(wp), intent(out) :: value
      logical, intent(out) :: is_found
      type(access_t) :: access

      access%number = number
      call self%declare_numbers(access)
      if (.not. access%is_found) call self%declare_inherited(access)
      value = access%value
      is_found = access%is_found
   end subroutine numbered_find_number

   !> Lists all numbers, in the order of their declaration.
   subroutine numbered_list_numbers(self, numbers)
      class(numbered_t), intent(inout) :: self              !! unchanged
      type(number_t), allocatable, intent(out) :: numbers(:)
      type(list_t) :: list

      allocate (list%found(0))
      call self%declare_numbers(list)
      call self%declare_inherited(list)
      call move_alloc(list%found, numbers)
   end subroutine numbered_list_numbers

   subroutine access_add_number(self, key, value, required, unit)
      class(access_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit

      if (key == self%number%key .and. all(self%number%element == 0)) call exchange(self, value)
   end subroutine access_add_number

   !> A list of one number may have no index.
   subroutine access_add_list(self, key, values, n, required)
      class(access_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required
      integer :: i

      if (key /= self%number%key .or. self%number%element(2) > 0 .or. .not. allocated(values)) return
      i = self%number%element(1)
      if (i == 0 .and. size(values) == 1) i = 1
      if (i >= 1 .and. i <= size(values)) call exchange(self, values(i))
   end subroutine access_add_list

   subroutine access_add_matrix(self, key, values, n, m, required)
      class(access_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer, intent(in) :: n, m
      logical, intent(in), optional :: required

      if (key /= self%number%key .or. .not. allocated(values)) return
      if (all(self%number%element >= 1) .and. all(self%number%element <= shape(values))) &
         call exchange(self, values(self%number%element(1), self%number%element(2)))
   end subroutine access_add_matrix

   subroutine exchange(self, value)
      class(access_t), intent(inout) :: self
      real(wp), intent(inout) :: value

      self%is_found = .true.
      if (self%sets) then
         value = self%value
      else
         self%value = value
      end if
   end subroutine exchange

   subroutine list_add_number(self, key, value, required, unit)
      class(list_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit

      self%found = [self%found, number_t(key)]
   end subroutine list_add_number

   subroutine list_add_list(self, key, values, n, required)
      class(list_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required
      integer :: i

      if (.not. allocated(values)) return
      self%found = [self%found, [(number_t(key, [i, 0]), i=1, size(values))]]
   end subroutine list_add_list

   subroutine list_add_matrix(self, key, values, n, m, required)
      class(list_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer, intent(in) :: n, m
      logical, intent(in), optional :: required
      integer :: i, k

      if (.not. allocated(values)) return
      self%found = [self%found, [((number_t(key, [i, k]), k=1, size(values, 2)), i=1, size(values, 1))]]
   end subroutine list_add_matrix
end module hb_numbers
