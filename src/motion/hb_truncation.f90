!> The harmonics that an input requests (`&harmonics`), before the set is created: sweeps compare thousands of these.
module hb_truncation
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t
   use hb_harmonics, only: exceeds_largest_box, harmonics_t, new_box, new_diamond, new_harmonics
   use hb_model, only: symmetry
   use hb_properties, only: properties_t
   use hb_text, only: to_text
   use hb_tuple_choice, only: new_lowest_set
   implicit none
   private
   public :: box_truncation, read_harmonics, read_lowest_set, read_truncation, truncation_t

   type :: truncation_t
      character(7) :: set = "box"                                     !! box, diamond or list
      logical :: odd_only = .false.
      integer :: symmetry = symmetry%auto                             !! of the motions in the set, one of `symmetry_t`
      integer, allocatable :: order(:)                                !! (n_tones), of a diamond the same for all; not of a list
      integer, allocatable :: tuples(:, :)                            !! (n_tones, any) of a list, signs as given
      character(:), allocatable :: location                           !! of the group, for messages
   contains
      procedure :: highest => truncation_highest
      procedure :: contains => truncation_contains
      procedure :: cannot_be_made => truncation_cannot_be_made
      procedure :: make => truncation_make
   end type truncation_t

contains

   !> All tuples with |j_m| <= order(m).
   function box_truncation(order) result(self)
      integer, intent(in) :: order(:)                                 !! (n_tones)
      type(truncation_t) :: self

      allocate (self%order, source=order)
      self%location = "the wider set of the certificate"
   end function box_truncation

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

   !> Creates the set; fails if it is empty or too large, or contains a tuple twice.
   subroutine truncation_make(self, harmonics, error)
      class(truncation_t), intent(in) :: self
      type(harmonics_t), intent(out) :: harmonics
      type(error_t), allocatable, intent(out) :: error

      select case (self%set)
      case ("box"); call new_box(harmonics, self%order, self%odd_only, error)
      case ("diamond"); call new_diamond(harmonics, size(self%order), self%order(1), self%odd_only, error)
      case default; call new_harmonics(harmonics, self%tuples, error)
      end select
      if (allocated(error)) call annotate(error, self%location)
   end subroutine truncation_make

   !> Largest |j_m| of each tone, (n_tones), of the set; all 0 if it would be empty.
   pure function truncation_highest(self) result(highest)
      class(truncation_t), intent(in) :: self
      integer, allocatable :: highest(:)
      integer :: m

      if (self%set == "list") then
         highest = maxval(abs(self%tuples), dim=2)
         return
      end if
      highest = self%order
      if (.not. self%odd_only) return
      if (self%set == "diamond") then
         highest = highest - merge(1, 0, modulo(highest, 2) == 0 .and. highest > 0)
      else if (count(self%order > 0) == 1) then                       ! another tone with an order would make the sum odd
         m = maxloc(self%order, dim=1)
         highest(m) = highest(m) - merge(1, 0, modulo(highest(m), 2) == 0)
      end if
   end function truncation_highest

   !> Whether a box or a diamond is empty, or part of a box that is too large; `make` reports this.
   pure logical function truncation_cannot_be_made(self)
      class(truncation_t), intent(in) :: self

      truncation_cannot_be_made = exceeds_largest_box(self%order) .or. (self%odd_only .and. all(self%order == 0))
   end function truncation_cannot_be_made

   !> Whether all tuples of another truncation are certain to be in this one: the same kind with orders that are not
   !> larger.
   pure logical function truncation_contains(self, other)
      class(truncation_t), intent(in) :: self
      type(truncation_t), intent(in) :: other

      truncation_contains = self%set /= "list" .and. self%set == other%set .and. (self%odd_only .eqv. other%odd_only)
      if (truncation_contains) truncation_contains = all(other%order <= self%order)
   end function truncation_contains
end module hb_truncation
