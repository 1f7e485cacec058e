!> The number of a model that a parameter of its document is, such as `law(2)%stiffness`.
module hb_parameter_number
   use hb_document, only: document_t, parameter_t
   use hb_kinds, only: wp
   use hb_model_number, only: has_number, model_number_t, moving_groups, numbered_groups
   use hb_text, only: to_text
   implicit none
   private
   public :: find_number, followed_groups, list_groups, locate_number

   !> Groups whose numbers a curve may follow.
   character(*), parameter :: followed_groups(*) = [character(len(moving_groups)) :: moving_groups, "normal_mode"]

contains

   !> The number of a model that a parameter of a document, from which the model was read, is; without an object if it is
   !> none, such as a word or an integer.
   subroutine find_number(document, parameter, number)
      type(document_t), intent(in) :: document
      type(parameter_t), intent(in) :: parameter
      type(model_number_t), intent(out) :: number

      call locate_number(document, parameter, number)
      associate (group => document%groups%holders(parameter%i_group)%group)
         number%name = group%name
         if (group%is_repeated) number%name = trim(number%name)//"("//to_text(group%number)//")"
         number%name = trim(number%name)//"%"//trim(parameter%key)
      end associate
      if (all(parameter%element > 0)) then
         number%name = trim(number%name)//"("//to_text(parameter%element(1))//", "//to_text(parameter%element(2))//")"
      else if (parameter%element(1) > 0) then
         number%name = trim(number%name)//"("//to_text(parameter%element(1))//")"
      end if
   end subroutine find_number

   !> The same without its name, for every point of a sweep.
   subroutine locate_number(document, parameter, number)
      type(document_t), intent(in) :: document
      type(parameter_t), intent(in) :: parameter
      type(model_number_t), intent(out) :: number
      logical :: is_number

      associate (group => document%groups%holders(parameter%i_group)%group)
         call group%find_limits(trim(parameter%key), parameter%element, is_number, number%minimum, number%maximum, number%above)
         if (is_number) number%object = findloc(numbered_groups%name == group%name, .true., dim=1)
         number%i = group%number
      end associate
      if (number%object == has_number%tones) then                     ! only an unknown tone may have the frequency 0
         number%minimum = -huge(1.0_wp)
         number%above = 0.0_wp
      end if
      number%key = parameter%key
      number%element = parameter%element
   end subroutine locate_number

   !> Lists some of the groups with numbers, for messages.
   pure function list_groups(are_listed, word) result(text)
      logical, intent(in) :: are_listed(:)                            !! as `numbered_groups`, one or more
      character(*), intent(in) :: word                                !! before the last one: and, or
      character(160) :: text
      integer, allocatable :: which(:)
      integer :: i

      which = pack([(i, i=1, size(are_listed))], are_listed)
      text = "&"//numbered_groups(which(1))%name
      do i = 2, size(which)
         if (i < size(which)) text = trim(text)//", &"//numbered_groups(which(i))%name
         if (i == size(which)) text = trim(text)//" "//word//" &"//numbered_groups(which(i))%name
      end do
   end function list_groups
end module hb_parameter_number
