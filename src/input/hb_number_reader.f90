!> Reads the numbers that an object declares (hb_numbers) from a group of properties.
module hb_number_reader
   use hb_kinds, only: wp
   use hb_numbers, only: numbered_t, numbers_t
   use hb_problems, only: problems_t
   use hb_properties, only: properties_t
   implicit none
   private
   public :: group_problems_t, read_numbers

   type, extends(numbers_t) :: reader_t
      type(properties_t), pointer :: group => null()
   contains
      procedure :: add_number => reader_add_number
      procedure :: add_list => reader_add_list
      procedure :: add_matrix => reader_add_matrix
      procedure :: add_integer => reader_add_integer
      procedure :: add_integers => reader_add_integers
      procedure :: add_logical => reader_add_logical
      procedure :: note_given => reader_note_given
      procedure :: reject => reader_reject
   end type reader_t

   !> Problems of an object as those of its group.
   type, extends(problems_t) :: group_problems_t
      type(properties_t), pointer :: group => null()
   contains
      procedure :: add => group_problems_add
   end type group_problems_t

contains

   !> Reads all that an object declares; the group collects the problems.
   subroutine read_numbers(object, group)
      class(numbered_t), intent(inout) :: object
      type(properties_t), intent(inout), target :: group
      type(reader_t) :: reader

      reader%group => group
      call object%declare_numbers(reader)
   end subroutine read_numbers

   subroutine reader_add_number(self, key, value, required, unit)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit

      call self%group%get(key, value, required, unit)
   end subroutine reader_add_number

   subroutine reader_add_list(self, key, values, n, required)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required

      call self%group%get(key, values, n, required)
   end subroutine reader_add_list

   subroutine reader_add_matrix(self, key, values, n, m, required)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: values(:, :)
      integer, intent(in) :: n, m
      logical, intent(in), optional :: required

      call self%group%get(key, values, n, m, required)
   end subroutine reader_add_matrix

   subroutine reader_add_integer(self, key, value)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(inout) :: value

      call self%group%get(key, value)
   end subroutine reader_add_integer

   subroutine reader_add_integers(self, key, values)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, allocatable, intent(inout) :: values(:)

      call self%group%get(key, values)
   end subroutine reader_add_integers

   subroutine reader_add_logical(self, key, value, word)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: value
      character(*), intent(in), optional :: word
      character(:), allocatable :: choice

      if (present(word)) then
         call self%group%get(key, choice)
         if (allocated(choice)) value = choice == word
      else
         call self%group%get(key, value)
      end if
   end subroutine reader_add_logical

   subroutine reader_note_given(self, key, is_given)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: is_given

      is_given = self%group%given(key)
   end subroutine reader_note_given

   subroutine reader_reject(self, key, text)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key, text

      if (self%group%given(key)) call self%group%problem(key, text)
   end subroutine reader_reject

   subroutine group_problems_add(self, key, text)
      class(group_problems_t), intent(inout) :: self
      character(*), intent(in) :: key, text

      call self%group%problem(key, text)
   end subroutine group_problems_add
end module hb_number_reader
