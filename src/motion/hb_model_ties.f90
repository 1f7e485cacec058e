!> Values of the input that follow others, from the groups `&tie`: the speed of a rotor that turns with a tone, for instance.
module hb_model_ties
   use hb_document, only: document_t, parameter_t, tie_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_properties, only: properties_t
   use hb_text, only: shown
   implicit none
   private
   public :: read_ties, refuse_unknown_tones

contains

   !> Reads the ties of a document, which keeps them, and sets what follows. Paths that name nothing are problems of their groups.
   subroutine read_ties(document)
      type(document_t), intent(inout), target :: document
      type(properties_t), pointer :: group
      type(tie_t), allocatable :: ties(:)
      character(:), allocatable :: path
      real(wp) :: number
      logical :: is_given
      integer :: i, n

      if (allocated(document%ties)) deallocate (document%ties)
      n = document%count("tie")
      if (n == 0) return
      allocate (ties(n))
      do i = 1, n
         group => document%group("tie", i)
         path = ""
         call group%get("parameter", path)
         call find_value(document, group, "parameter", path, ties(i)%parameter)
         path = ""
         call group%get("to", path)
         call find_value(document, group, "to", path, ties(i)%to)
         call group%get("factor", ties(i)%factor)
         call group%get("offset", ties(i)%offset)
         if (ties(i)%parameter%i_group == 0 .or. ties(i)%to%i_group == 0) then
            deallocate (ties)
            return
         end if
         call document%number_at(ties(i)%to, number, is_given)
         if (.not. is_given) call group%problem("to", "has no number in this input: give it one")
      end do
      do i = 1, n
         if (any([(ties(n)%parameter%hides(ties(i)%to), n=i, size(ties))])) then
            group => document%group("tie", i)
            call group%problem("to", "follows another value by a later &tie, or by this one; put that before this one")
         end if
      end do
      call move_alloc(ties, document%ties)
      call document%follow_ties()
   end subroutine read_ties

   !> Looks a path up that a key has; what is wrong with it is a problem of the key.
   subroutine find_value(document, group, key, path, parameter)
      type(document_t), intent(inout) :: document
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key, path                           !! empty: not given, which has been reported
      type(parameter_t), intent(out) :: parameter
      type(error_t), allocatable :: error

      if (len(path) == 0) return
      call document%resolve(path, parameter, error)
      if (.not. allocated(error)) return
      parameter%i_group = 0
      call group%problem(key, "'"//trim(shown(path))//"' "//error%message)
   end subroutine find_value

   !> Adds a problem for each tie to the frequency of a tone that is unknown.
   subroutine refuse_unknown_tones(document, is_unknown)
      type(document_t), intent(inout), target :: document
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      type(properties_t), pointer :: group
      integer :: i

      if (.not. (allocated(document%ties) .and. any(is_unknown))) return
      do i = 1, size(document%ties)
         associate (to => document%ties(i)%to)
            if (document%groups%holders(to%i_group)%group%name /= "tones") cycle
            if (.not. is_unknown(min(size(is_unknown), max(1, to%element(1))))) cycle
         end associate
         group => document%group("tie", i)
         call group%problem("to", "is the frequency of a tone that is found, not given")
      end do
   end subroutine refuse_unknown_tones
end module hb_model_ties
