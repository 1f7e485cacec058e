!> Reads the group `&harmonics`.
module hb_truncation_reader
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_properties, only: properties_t
   use hb_text, only: to_text
   use hb_truncation, only: truncation_t
   use hb_tuple_choice, only: new_lowest_set
   implicit none
   private
   public :: read_harmonics, read_lowest_set, read_truncation

contains

   !> Reads `&harmonics`: `set` = box, diamond or list, with `order`, `odd_only`, `tuples`; and `symmetry`.
   subroutine read_truncation(self, document, n_tones, error)
      type(truncation_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      integer, allocatable :: order(:), tuples(:)
      character(:), allocatable :: set

      call document%required_group("harmonics", group, error)
      if (allocated(error)) return
      call group%get("set", set)
      call group%choose("symmetry", self%symmetry)
      if (set == "list") then
         call group%get("tuples", tuples)
         if (allocated(tuples)) then
            if (modulo(size(tuples), n_tones) /= 0) call group%problem("tuples", to_text(size(tuples))// &
               " integers are not a whole number of tuples of "//to_text(n_tones)//" tones")
         end if
      else
         call group%get("order", order)
         call group%get("odd_only", self%odd_only)
         if (allocated(order)) then
            if (size(order) == 1 .and. set == "box") order = spread(order(1), 1, n_tones)
            if (size(order) /= merge(n_tones, 1, set == "box")) call group%problem("order", &
               "give one number, or for a box one for each of the "//to_text(n_tones)//" tones")
         end if
      end if
      call group%finish(error)
      if (allocated(error)) return
      self%set = set
      self%location = group%location()
      if (set == "list") then
         self%tuples = reshape(tuples, [n_tones, size(tuples)/n_tones])
      else
         self%order = order
         if (set == "diamond") self%order = spread(order(1), 1, n_tones)
      end if
   end subroutine read_truncation

   !> Reads `&harmonics` and creates its set.
   subroutine read_harmonics(self, document, n_tones, error, chosen_symmetry)
      type(harmonics_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out), optional :: chosen_symmetry               !! one of `symmetry_t`
      type(truncation_t) :: truncation

      call read_truncation(truncation, document, n_tones, error)
      if (present(chosen_symmetry)) chosen_symmetry = truncation%symmetry
      if (.not. allocated(error)) call truncation%make(self, error)
   end subroutine read_harmonics

   !> Creates the set from which the search for one begins: a small box with the tuples of all loads and first
   !> guesses. Reads the keys of `&harmonics` that do not specify the set.
   subroutine read_lowest_set(self, document, loaded, error, chosen_symmetry)
      type(harmonics_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: loaded(:, :)                             !! tuples of loads and first guesses, (n_tones, any)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out) :: chosen_symmetry                         !! one of `symmetry_t`
      type(properties_t), pointer :: group

      group => document%optional_group("harmonics")
      call group%choose("symmetry", chosen_symmetry)
      call group%finish(error)
      if (allocated(error)) return
      call new_lowest_set(self, size(loaded, 1), loaded, error)
   end subroutine read_lowest_set
end module hb_truncation_reader
