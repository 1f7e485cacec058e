!> Reads the numbers that an object declares (hb_numbers) from a group of properties.
module hb_number_reader
   use hb_kinds, only: wp
   use hb_numbers, only: numbered_t, numbers_t
   use hb_properties, only: properties_t
   implicit none
   private
   public :: read_numbers

   type, extends(numbers_t) :: reader_t
      type(properties_t), pointer :: group => null()
   contains
      procedure :: add_number => reader_add_number
      procedure :: add_list => reader_add_list
      procedure :: add_matrix => reader_add_matrix
   end type reader_t

contains

   !> Reads all numbers of an object; the group collects the problems.
   subroutine read_numbers(object, group)
      class(numbered_t), intent(inout) :: object
      type(properties_t), intent(inout), target :: group
      type(reader_t) :: reader

      reader%group => group
      call object%declare_numbers(reader)
   end subroutine read_numbers

   subroutine reader_add_number(self, key, value)
      class(reader_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value

      call self%group%get(key, value)
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
end module hb_number_reader
