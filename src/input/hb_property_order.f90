!> Maps the values of a key to the indices of a single value, a list or a matrix.
!>
!> A key has listed values, single elements like key(2) or key(1, 2), or both if an override changes elements of a
!> list. `pick` returns the numbers of the values in the order of the indices.
module hb_property_order
   use hb_kinds, only: int64
   use hb_property_record, only: key_problem, record_t, value_problem
   use hb_property_values, only: element_text, max_values
   use hb_text, only: length_of, number_of, to_text
   implicit none
   private
   public :: any_length, element_at, matrix_text, pick

   integer, parameter :: any_length = -1                    !! of a list

contains

   !> Selects the values of a key that is a single value, a list or a matrix.
   pure subroutine pick(self, i_key, extents, order)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: extents(:)                     !! empty, [length or any_length], [rows, columns]
      integer, allocatable, intent(out) :: order(:)         !! row by row; not allocated after a problem
      character(:), allocatable :: name, problem
      integer(int64) :: n, n_found, n_needed
      integer :: gap
      logical :: is_good, is_matrix

      name = trim(self%content%names%names(i_key))
      call check_elements(self, i_key, extents, name, n, is_good)
      if (.not. is_good) return
      problem = ""
      is_matrix = size(extents) == 2
      n_needed = product(int(extents, int64))               ! negative: any
      associate (key => self%content%keys(i_key))
         n_found = n
         if (is_matrix) n_found = merge(key%n_listed, key%n_elements, key%n_listed > 0)
         if (size(extents) == 0 .and. n /= 1) problem = "has "//number_of(int(n), "value")//", needs one"
         if (is_matrix .and. n_found /= n_needed .and. (key%n_listed > 0 .or. n_needed > max_values)) &
            problem = "has "//number_of(int(n_found), "value")//", needs "//to_text(n_needed)//": "// &
                      matrix_text(extents(1), extents(2))//", row by row"
      end associate
      if (problem == "") then
         allocate (order(merge(n_needed, n, is_matrix)), source=0)
         call fill(self, i_key, extents, order, is_good)
         if (.not. is_good) deallocate (order)
         if (.not. is_good) return
         gap = findloc(order, 0, dim=1)
         if (is_matrix .and. gap > 0) then
            associate (element => element_at(gap, extents))
               problem = "has "//number_of(int(n_found), "value")//", needs "//to_text(n_needed)//": "// &
                         element_text(name, element(1), element(2))//" is missing"
            end associate
         else if (gap > 0) then
            problem = "has no element ("//to_text(gap)//"), but one ("//to_text(n)//")"
         else if (size(extents) == 1 .and. n_needed >= 0 .and. n /= n_needed) then
            problem = "has "//number_of(int(n), "value")//", needs "//to_text(n_needed)
         end if
      end if
      if (problem == "") return
      call key_problem(self, i_key, problem)
      if (allocated(order)) deallocate (order)
   end subroutine pick

   !> Checks the indices of single elements; returns the number of positions of listed values and elements.
   pure subroutine check_elements(self, i_key, extents, name, n, is_good)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: extents(:)                     !! as for `pick`
      character(*), intent(in) :: name
      integer(int64), intent(out) :: n
      logical, intent(out) :: is_good
      character(:), allocatable :: problem
      integer :: element(2), k

      n = self%content%keys(i_key)%n_listed
      is_good = .true.
      do k = first_element(self, i_key), self%content%keys(i_key)%n
         element = [self%content%keys(i_key)%values(k)%i, self%content%keys(i_key)%values(k)%j]
         n = max(n, int(element(1), int64))
         is_good = .false.
         if (size(extents) == 0) then
            call key_problem(self, i_key, "is a single value; give it without an index")
         else if (size(extents) == 1 .and. element(2) /= 0) then
            call key_problem(self, i_key, "is a list; its elements have one index, like "//name//"(2)")
         else if (size(extents) == 2 .and. element(2) == 0) then
            call value_problem(self, i_key, k, element, "is an element of a matrix; write "//name//"(i, j)")
         else if (any(element(:size(extents)) > extents .and. extents /= any_length)) then
            problem = "list has "//to_text(extents(1))//" elements"
            if (size(extents) == 2) problem = "matrix has "//matrix_text(extents(1), extents(2))
            call value_problem(self, i_key, k, element, "is out of range: the "//problem)
         else
            is_good = .true.
         end if
         if (.not. is_good) return
      end do
   end subroutine check_elements

   pure integer function first_element(self, i_key)
      class(record_t), intent(in) :: self
      integer, intent(in) :: i_key

      associate (key => self%content%keys(i_key))
         first_element = key%n - key%n_elements + 1
      end associate
   end function first_element

   !> Indices of the element at position `k` of the result of `pick`: 0 for those that it does not have.
   pure function element_at(k, extents) result(element)
      integer, intent(in) :: k
      integer, intent(in) :: extents(:)                     !! as for `pick`
      integer :: element(2)

      element = 0
      if (size(extents) == 1) element(1) = k
      if (size(extents) == 2) element = [(k - 1)/extents(2) + 1, mod(k - 1, extents(2)) + 1]
   end function element_at

   !> Stores the listed values of a key in the first positions of `order`, then the elements at theirs; over listed values they come
   !> from an override.
   pure subroutine fill(self, i_key, extents, order, is_good)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: extents(:)                     !! as for `pick`
      integer, intent(inout) :: order(:)
      logical, intent(out) :: is_good                       !! false after a problem
      integer :: k, n, position

      is_good = .true.
      n = 0
      associate (key => self%content%keys(i_key))
         do k = 1, key%n
            associate (value => key%values(k))
               if (k < first_element(self, i_key)) then
                  order(n + 1:n + value%count) = k
                  n = n + value%count
                  cycle
               end if
               position = value%i
               if (size(extents) == 2) position = (value%i - 1)*extents(2) + value%j
               is_good = key%n_listed > 0 .or. order(position) == 0
               if (.not. is_good) call value_problem(self, i_key, k, [value%i, value%j], "is given again; give it once")
               if (.not. is_good) return
               order(position) = k
            end associate
         end do
      end associate
   end subroutine fill

   !> Text for the size of a matrix.
   pure function matrix_text(n, m) result(text)
      integer, intent(in) :: n, m
      character(length_of(n) + len(" rows and ") + length_of(m) + len(" columns")) :: text

      text = to_text(n)//" rows and "//to_text(m)//" columns"
   end function matrix_text
end module hb_property_order
