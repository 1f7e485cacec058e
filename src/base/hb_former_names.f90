!> Names of keys, groups, values, statuses and verbs before 0.1.0. An input or a command that has one is refused with the present name.
module hb_former_names
   implicit none
   private
   public :: is_renamed

   character(*), parameter :: names(2, 7) = reshape([character(23) :: &
      "march", "integrate", &                               ! the verb
      "march", "integration", &                             ! the group and the value
      "marched", "time_domain", &
      "rescue", "fallback", &
      "rescue_by_march", "fallback_by_integration", &
      "rescue_work", "fallback_work", &
      "first_way", "primary_method"], [2, 7])

contains

   !> Whether a word was the name of what is called `now`.
   pure logical function is_renamed(word, now)
      character(*), intent(in) :: word, now                 !! lower case

      is_renamed = any(names(1, :) == word .and. names(2, :) == now)
   end function is_renamed
end module hb_former_names
