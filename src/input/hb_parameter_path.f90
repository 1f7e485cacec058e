!> Paths to parameters of a document, such as law(2)%gap: their parts, and the group that they name.
module hb_parameter_path
   use hb_error, only: error_t, fail
   use hb_input_keys, only: kind_of
   use hb_properties, only: properties_t
   use hb_property_groups, only: groups_t
   use hb_property_values, only: max_values
   use hb_similar_word, only: closest_word
   use hb_text, only: is_name, letters, lower, parse_integer, quote, shown, string_t, to_text
   implicit none
   private
   public :: check_label, identifier, index_help, path_help, select_group, split_index, split_path

   character(*), parameter :: path_help = &
      "a path is like solver%tolerance, law(2)%gap, law(label)%gap or tones%frequency(2)"

   character(*), parameter :: index_help = "must be like (2) or (1, 2), each from 1 to "

contains

   !> Splits name(selector)%key into its parts; the selector is empty without brackets, the key in an invalid path.
   pure subroutine split_path(path, name, selector, key)
      character(*), intent(in) :: path
      character(:), allocatable, intent(out) :: name, selector, key
      integer :: close, first

      selector = ""
      key = ""
      first = scan(path, "(%")
      name = lower(trim(path(1:max(0, first - 1))))
      if (first == 0) return
      if (path(first:first) == "%") then
         key = trim(adjustl(path(first + 1:)))
         return
      end if
      close = index(path, ")%")
      if (close <= first + 1) return
      selector = trim(adjustl(path(first + 1:close - 1)))
      if (len(selector) > 0) key = trim(adjustl(path(close + 2:)))
   end subroutine split_path

   !> Separates the index (i) or (i, j) from a key.
   pure subroutine split_index(key, name, i, j, is_good)
      character(*), intent(in) :: key                       !! such as frequency(2)
      character(:), allocatable, intent(out) :: name        !! lower case
      integer, intent(out) :: i, j                          !! 0 where there is none
      logical, intent(out) :: is_good                       !! the name is a name, the index one from 1 to `max_values`
      integer :: close, comma, first

      i = 0
      j = 0
      first = index(key, "(")
      if (first == 0) first = len(key) + 1
      name = lower(trim(key(:first - 1)))
      is_good = is_name(name)
      if (first > len(key) .or. .not. is_good) return
      close = len_trim(key)
      is_good = key(close:close) == ")"
      if (.not. is_good) return
      associate (inside => key(first + 1:close - 1))
         comma = index(inside, ",")
         if (comma == 0) then
            call parse_integer(trim(adjustl(inside)), i, is_good)
         else
            call parse_integer(trim(adjustl(inside(1:comma - 1))), i, is_good)
            if (is_good) call parse_integer(trim(adjustl(inside(comma + 1:))), j, is_good)
            is_good = is_good .and. j > 0
         end if
         is_good = is_good .and. i > 0 .and. max(i, j) <= max_values
      end associate
   end subroutine split_index

   !> Number of the group that a path names; fails when there is none, or more than one.
   pure subroutine select_group(groups, name, selector, i_group, error)
      type(groups_t), intent(in) :: groups
      character(*), intent(in) :: name                      !! of existing groups, lower case
      character(*), intent(in) :: selector                  !! number, label, or empty for the only one
      integer, intent(out) :: i_group
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: labels(:)
      character(:), allocatable :: text
      integer :: i, n, n_matches, number
      logical :: is_number

      i_group = 0
      n = groups%count(name)
      if (len(selector) == 0) then
         i_group = groups%position_of(name, 1)
         if (n > 1) call fail(error, &
               "there are "//to_text(n)//" groups &"//name//"; write "//name//"(1) to "//name// &
                              "("//to_text(n)//"), or "//name//"(label)")
         return
      end if
      call parse_integer(selector, number, is_number)
      if (is_number) then
         if (number < 1 .or. number > n) then
            text = "there is no "//name//"("//shown(selector)//"); the input has "//name//"(1)"
            if (n > 1) text = text//" to "//name//"("//to_text(n)//")"
            call fail(error, text)
         else
            i_group = groups%position_of(name, number)
         end if
         return
      end if
      allocate (labels(n))
      n_matches = 0
      do i = 1, n
         call get_label(groups%holders(groups%position_of(name, i))%group, labels(i)%value)
         if (labels(i)%value /= selector) cycle
         n_matches = n_matches + 1
         i_group = groups%position_of(name, i)
      end do
      if (n_matches > 1) then
         call fail(error, &
                   to_text(n_matches)//" groups &"//name//" have the label "//quote(shown(selector))// &
                   "; use their numbers")
      else if (n_matches == 0) then
         text = closest_word(selector, labels)
         if (text /= "") text = " did you mean "//quote(text)//"?"
         text = "no group &"//name//" has the label "//quote(shown(selector))//";"//text
         call add_labels(labels, text)
         call fail(error, text)
      end if
   end subroutine select_group

   !> Adds the first twenty labels that are not empty to a message.
   pure subroutine add_labels(labels, message)
      type(string_t), intent(in) :: labels(:)
      character(:), allocatable, intent(inout) :: message
      character(:), allocatable :: text
      integer :: i, n

      text = ""
      n = 0
      do i = 1, size(labels)
         if (len(labels(i)%value) == 0 .or. n == 20) cycle
         n = n + 1
         if (n > 1) text = text//", "
         text = text//quote(shown(labels(i)%value))
      end do
      if (n == 0) then
         message = message//" none has a label; refer to them by number"
      else
         message = message//" labels: "//text
      end if
   end subroutine add_labels

   !> Reports a given label that no path can contain, or that it would take for a number.
   subroutine check_label(group, label)
      type(properties_t), intent(inout) :: group
      character(:), allocatable, intent(in) :: label        !! not allocated: the given value is no text
      integer :: number
      logical :: is_number

      if (.not. (group%given("label") .and. allocated(label))) return
      call parse_integer(label, number, is_number)
      if (len_trim(label) == 0) then
         call group%problem("label", "is empty; leave it out, or give a name for paths such as law(name)%gap")
      else if (is_number) then
         call group%problem("label", quote(label)//" is a number, by which paths count groups; a name has a letter")
      else if (scan(label, "()%") > 0) then
         call group%problem("label", quote(shown(label))//" cannot be part of a path: leave out '(', ')' and '%'")
      end if
   end subroutine check_label

   !> Returns the value of the key `label` of a group, empty if it has none.
   pure subroutine get_label(group, label)
      type(properties_t), intent(in) :: group
      character(:), allocatable, intent(out) :: label
      integer :: i_key

      label = ""
      i_key = group%content%names%find("label")
      if (.not. group%content%is_given(i_key)) return
      associate (value => group%content%keys(i_key)%values(1))
         if (value%i > 0) return
         if (value%kind == kind_of%word) call group%content%get_word(i_key, 1, label)
         if (value%kind /= kind_of%word) call group%content%get_shown(i_key, 1, label)
      end associate
      label = trim(label)
   end subroutine get_label

   !> Returns a path in lower case with one underscore for every run of other characters, none at the ends.
   pure function identifier(path) result(name)
      character(*), intent(in) :: path
      character(identifier_length(path)) :: name
      character(len(path)) :: buffer
      integer :: n

      call write_identifier(path, buffer, n)
      name = buffer
   end function identifier

   pure integer function identifier_length(path) result(n)
      character(*), intent(in) :: path
      character(len(path)) :: buffer

      call write_identifier(path, buffer, n)
   end function identifier_length

   pure subroutine write_identifier(path, name, n)
      character(*), intent(in) :: path
      character(*), intent(out) :: name
      integer, intent(out) :: n                             !! its length
      character :: letter
      integer :: i

      n = 0
      do i = 1, len(path)
         letter = lower(path(i:i))
         if (scan(letter, letters//"0123456789") == 0) then
            letter = "_"
            if (n == 0) cycle
            if (name(n:n) == letter) cycle
         end if
         n = n + 1
         name(n:n) = letter
      end do
      if (n > 0) n = n - merge(1, 0, name(n:n) == "_")
   end subroutine write_identifier
end module hb_parameter_path
