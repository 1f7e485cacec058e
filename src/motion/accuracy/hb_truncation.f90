!> A set of harmonics before it is created: sweeps compare thousands of these.
module hb_truncation
   use hb_discretisation, only: symmetry
   use hb_error, only: annotate, error_t
   use hb_harmonics, only: exceeds_largest_box, harmonics_t, new_box, new_diamond, new_harmonics
   implicit none
   private
   public :: box_truncation, truncation_t

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
      self%location = "the wider set of the error estimate"
   end function box_truncation

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
