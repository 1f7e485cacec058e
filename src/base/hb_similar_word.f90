!> The known word that is closest to a misspelt one. Source of the distance: Damerau-Levenshtein, restricted to one swap of
!> neighbours per position.
module hb_similar_word
   use hb_text, only: lower, string_t
   implicit none
   private
   public :: closest_word

   integer, parameter :: max_word = 63                      !! longest word that is examined

   !> Returns the known word that was probably meant by `word`, ignoring case; empty if none is close.
   interface closest_word
      module procedure closest_string, closest_of_words
   end interface closest_word

contains

   pure function closest_string(word, known) result(closest)
      character(*), intent(in) :: word
      type(string_t), intent(in) :: known(:)
      character(closest_length(word, known)) :: closest

      if (len(closest) > 0) closest = known(closest_index(word, known))%value
   end function closest_string

   pure function closest_of_words(word, known) result(closest)
      character(*), intent(in) :: word
      character(*), intent(in) :: known(:)
      character(len(known)) :: closest                       !! padded with blanks
      type(string_t) :: words(size(known))
      integer :: i

      do i = 1, size(known)
         words(i)%value = trim(known(i))
      end do
      closest = closest_string(word, words)
   end function closest_of_words

   pure integer function closest_length(word, known) result(length)
      character(*), intent(in) :: word
      type(string_t), intent(in) :: known(:)
      integer :: i

      length = 0
      i = closest_index(word, known)
      if (i > 0) length = len_trim(known(i)%value)
   end function closest_length

   !> Index of the closest known word, the first of several; 0 if none is close.
   pure integer function closest_index(word, known)
      character(*), intent(in) :: word
      type(string_t), intent(in) :: known(:)
      integer :: best, distance, i

      closest_index = 0
      best = huge(best)
      do i = 1, size(known)
         if (.not. allocated(known(i)%value)) cycle
         distance = distance_if_close(lower(trim(word)), lower(trim(known(i)%value)))
         if (distance >= best) cycle
         best = distance
         closest_index = i
      end do
   end function closest_index

   !> Edit distance (insert, delete, replace, swap of neighbours), or huge() if the words are not close. Close means
   !> at most one edit per three letters, or a common beginning of at least three letters.
   pure integer function distance_if_close(word, known) result(distance)
      character(*), intent(in) :: word, known
      integer :: rows(-1:max_word, 0:2)                     !! last, last but one and current row, rotating
      integer :: before, current, i, j, last

      distance = huge(distance)
      if (len(word) > max_word .or. len(known) > max_word .or. len(word) == 0 .or. len(known) == 0) return
      rows = 0
      do j = 0, len(known)
         rows(j, 0) = j
      end do
      do i = 1, len(word)
         current = mod(i, 3)
         last = mod(i + 2, 3)
         before = mod(i + 1, 3)
         rows(0, current) = i
         do j = 1, len(known)
            rows(j, current) = min(rows(j, last) + 1, rows(j - 1, current) + 1, &
                                   rows(j - 1, last) + merge(0, 1, word(i:i) == known(j:j)))
            if (i == 1 .or. j == 1) cycle
            if (word(i:i) == known(j - 1:j - 1) .and. word(i - 1:i - 1) == known(j:j)) then
               rows(j, current) = min(rows(j, current), rows(j - 2, before) + 1)
            end if
         end do
      end do
      distance = rows(len(known), mod(len(word), 3))
      if (distance <= max(len(word), len(known))/3) return
      if (min(len(word), len(known)) >= 3 .and. (index(known, word) == 1 .or. index(word, known) == 1)) return
      distance = huge(distance)
   end function distance_if_close
end module hb_similar_word
