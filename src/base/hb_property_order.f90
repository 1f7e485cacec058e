!> Which value of a key stands at which place of a single value, a list or a matrix.
!>
!> A key has listed values, single elements like key(2) or key(1, 2), or both where an override changes
!> elements of a list. `pick` puts the numbers of the values in the order of the places.
module hb_property_order
   use hb_kinds, only: int64
   use hb_property_record, only: key_problem, record_t, value_problem
   use hb_property_values, only: element_text, max_values
   use hb_text, only: to_text
   implicit none
   private
   public :: any_length, element_at, matrix_text, pick

   integer, parameter :: any_length = -1                    !! of a list

contains

   !> Picks the values of a key that holds a single value, a list or a matrix.
   pure subroutine pick(self, i_key, extents, order)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: extents(:)                     !! empty, [length or any_length], [rows, columns]
      integer, allocatable, intent(out) :: order(:)         !! row by row; not allocated after a problem

      select case (size(extents))
      case (0)
         call pick_one(self, i_key, order)
      case (1)
         call pick_list(self, i_key, extents(1), order)
      case (2)
         call pick_matrix(self, i_key, extents(1), extents(2), order)
      end select
   end subroutine pick

   !> Indices of the element at place `k` of what `pick` returns: 0 where it has none.
   pure function element_at(k, extents) result(element)
      integer, intent(in) :: k
      integer, intent(in) :: extents(:)                     !! as for `pick`
      integer :: element(2)

      element = 0
      if (size(extents) == 1) element(1) = k
      if (size(extents) == 2) element = [(k - 1)/extents(2) + 1, mod(k - 1, extents(2)) + 1]
   end function element_at

   pure subroutine pick_one(self, i_key, order)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, allocatable, intent(out) :: order(:)

      associate (key => self%content%keys(i_key))
         if (key%element_head > 0) then
            call key_problem(self, i_key, "is a single value; give it without an index")
         else if (key%n_listed /= 1) then
            call key_problem(self, i_key, "has "//to_text(key%n_listed)//" values, needs one")
         else
            order = [key%head]
         end if
      end associate
   end subroutine pick_one

   pure subroutine pick_list(self, i_key, n_needed, order)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: n_needed                       !! or any_length
      integer, allocatable, intent(out) :: order(:)
      character(:), allocatable :: name
      integer :: first_gap, i_value, n
      logical :: is_good

      name = trim(self%content%names%names(i_key))
      associate (key => self%content%keys(i_key), values => self%content%values)
         n = key%n_listed
         i_value = key%element_head
         do while (i_value > 0)
            associate (value => values(i_value))
               if (value%j /= 0) then
                  call key_problem(self, i_key, "is a list; its elements have one index, like "//name//"(2)")
                  return
               else if (n_needed /= any_length .and. value%i > n_needed) then
                  call value_problem(self, i_key, i_value, [value%i, 0], &
                     "is out of range: the list has "//to_text(n_needed)//" elements")
                  return
               end if
               n = max(n, value%i)
               i_value = value%next
            end associate
         end do
         allocate (order(n), source=0)
         is_good = .true.
         call fill_listed(self, i_key, order)
         call fill_elements(self, i_key, 0, order, is_good)
         first_gap = findloc(order, 0, dim=1)
         if (is_good .and. first_gap > 0) then
            call key_problem(self, i_key, &
               "has no element ("//to_text(first_gap)//"), but one ("//to_text(n)//")")
            is_good = .false.
         else if (is_good .and. n_needed /= any_length .and. n /= n_needed) then
            call key_problem(self, i_key, "has "//counted(int(n, int64))//", needs "//to_text(n_needed))
            is_good = .false.
         end if
         if (.not. is_good) deallocate (order)
      end associate
   end subroutine pick_list

   pure subroutine pick_matrix(self, i_key, n, m, order)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: n, m
      integer, allocatable, intent(out) :: order(:)
      character(:), allocatable :: name
      integer(int64) :: n_found, n_needed
      integer :: gap, i_value
      logical :: is_good

      name = trim(self%content%names%names(i_key))
      n_needed = int(max(n, 0), int64)*int(max(m, 0), int64)
      associate (key => self%content%keys(i_key), values => self%content%values)
         i_value = key%element_head
         do while (i_value > 0)
            associate (value => values(i_value))
               if (value%j == 0) then
                  call value_problem(self, i_key, i_value, [value%i, 0], &
                                     "is an element of a matrix; write "//name//"(i, j)")
                  return
               else if (value%i > n .or. value%j > m) then
                  call value_problem(self, i_key, i_value, [value%i, value%j], &
                                     "is out of range: the matrix has "//matrix_text(n, m))
                  return
               end if
               i_value = value%next
            end associate
         end do
         n_found = int(key%n_listed, int64)
         if (key%head == 0) n_found = int(key%n_elements, int64)
         if (n_found /= n_needed .and. (key%head > 0 .or. n_needed > int(max_values, int64))) then
            call key_problem(self, i_key, "has "//counted(n_found)//", needs "//to_text(n_needed)//": "// &
                             matrix_text(n, m)//", row by row")
            return
         end if
         allocate (order(n_needed), source=0)
         is_good = .true.
         call fill_listed(self, i_key, order)
         call fill_elements(self, i_key, m, order, is_good)
         gap = findloc(order, 0, dim=1) - 1
         if (is_good .and. gap >= 0) then
            call key_problem(self, i_key, "has "//counted(n_found)//", needs "//to_text(n_needed)//": "// &
                             element_text(name, gap/m + 1, mod(gap, m) + 1)//" is missing")
            is_good = .false.
         end if
         if (.not. is_good) deallocate (order)
      end associate
   end subroutine pick_matrix

   !> Puts the listed values of a key into the first places of `order`.
   pure subroutine fill_listed(self, i_key, order)
      class(record_t), intent(in) :: self
      integer, intent(in) :: i_key
      integer, intent(inout) :: order(:)
      integer :: i_value, n

      n = 0
      i_value = self%content%keys(i_key)%head
      do while (i_value > 0)
         associate (value => self%content%values(i_value))
            order(n + 1:n + value%count) = i_value
            n = n + value%count
            i_value = value%next
         end associate
      end do
   end subroutine fill_listed

   !> Puts the elements of a key to their places in `order`; over listed values they come from an override.
   pure subroutine fill_elements(self, i_key, m, order, is_good)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: m                              !! columns of a matrix, 0 for a list
      integer, intent(inout) :: order(:)
      logical, intent(inout) :: is_good                     !! false after a problem
      integer :: i_value, position

      i_value = self%content%keys(i_key)%element_head
      do while (i_value > 0)
         associate (value => self%content%values(i_value))
            position = value%i
            if (m > 0) position = (value%i - 1)*m + value%j
            if (self%content%keys(i_key)%head == 0 .and. order(position) > 0) then
               call value_problem(self, i_key, i_value, [value%i, value%j], "is given again; give it once")
               is_good = .false.
               return
            end if
            order(position) = i_value
            i_value = value%next
         end associate
      end do
   end subroutine fill_elements

   !> Says how large a matrix is.
   pure function matrix_text(n, m) result(text)
      integer, intent(in) :: n, m
      character(:), allocatable :: text

      text = to_text(n)//" rows and "//to_text(m)//" columns"
   end function matrix_text

   !> "1 value", "2 values".
   pure function counted(n) result(text)
      integer(int64), intent(in) :: n
      character(:), allocatable :: text

      text = to_text(n)//" values"
      if (n == 1) text = "1 value"
   end function counted
end module hb_property_order
