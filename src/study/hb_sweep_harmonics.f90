!> The union of the harmonic sets of all points of a sweep, so that its file can be created before any point is
!> solved.
!> Every combination of swept values of `&harmonics` is read, but of nested boxes and diamonds only the largest are
!> created: the time for a sweep over N orders is proportional to N.
module hb_sweep_harmonics
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t
   use hb_harmonics, only: harmonics_t
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: to_text
   use hb_truncation, only: box_truncation, truncation_t
   use hb_truncation_reader, only: read_truncation
   use hb_tuple_choice, only: tuple_union_t
   use hb_wider_discretisation, only: choose_wider_set, wider_orders
   implicit none
   private
   public :: tuples_of_sweep

   character(*), parameter :: group = "harmonics"

contains

   !> Collects the tuples of all points: first those of the first point, then those that others add.
   subroutine tuples_of_sweep(tuples, first, plan, input, has_improved, error)
      integer, allocatable, intent(out) :: tuples(:, :)               !! (n_tones, any), each once
      type(harmonics_t), intent(in) :: first                          !! set of the first point
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: input                           !! before values of the sweep are set
      logical, intent(in) :: has_improved                             !! with the wider sets of improved motions
      type(error_t), allocatable, intent(out) :: error
      type(tuple_union_t) :: union

      call union%add(first%tuples)
      if (has_improved) call add_wider(union, first, error)
      if (.not. allocated(error)) call add_points(union, plan, input, first%n_tones, has_improved, error)
      if (.not. allocated(error)) tuples = union%list()
   end subroutine tuples_of_sweep

   !> Adds the tuples of the sets of the other points.
   subroutine add_points(union, plan, input, n_tones, has_improved, error)
      type(tuple_union_t), intent(inout) :: union
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: input
      integer, intent(in) :: n_tones
      logical, intent(in) :: has_improved
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(truncation_t) :: truncation, wider
      type(truncation_t), allocatable :: largest(:), widest(:)        ! none contains another
      logical, allocatable :: axes(:)
      integer :: i, point

      allocate (axes, source=plan%axes_of(group))
      if (.not. any(axes)) return
      allocate (largest(0), widest(0))
      document = input
      do i = 1, plan%n_combinations(axes)
         point = plan%point_of_combination(axes, i)
         call plan%apply(point, document)
         if (i > 1 .and. .not. document%has_changed([group])) cycle
         call document%begin()
         call read_truncation(truncation, document, n_tones, error)
         call document%accept_changes()
         if (allocated(error)) then
            call annotate(error, location_of(point))
            return
         end if
         truncation%location = location_of(point)//": "//truncation%location
         if (truncation%set == "list") then
            call add_set(union, truncation, has_improved, error)
         else
            call add_largest(largest, truncation, error)
            if (has_improved .and. .not. allocated(error)) then
               wider = box_truncation(wider_orders(truncation%highest()))
               wider%location = location_of(point)//": "//wider%location
               call add_largest(widest, wider, error)
            end if
         end if
         if (allocated(error)) return
      end do
      largest = [largest, widest]
      do i = 1, size(largest)
         call add_set(union, largest(i), .false., error)
         if (allocated(error)) return
      end do
   end subroutine add_points

   !> Adds a truncation unless an existing one contains it, and removes those that it contains. A truncation that
   !> cannot be created is an error.
   subroutine add_largest(largest, truncation, error)
      type(truncation_t), allocatable, intent(inout) :: largest(:)
      type(truncation_t), intent(in) :: truncation
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: set
      integer, allocatable :: retained(:)
      integer :: i

      if (truncation%cannot_be_made()) then
         call truncation%make(set, error)
         if (allocated(error)) return
      end if
      if (any([(largest(i)%contains(truncation), i=1, size(largest))])) return
      retained = pack([(i, i=1, size(largest))], [(.not. truncation%contains(largest(i)), i=1, size(largest))])
      largest = [largest(retained), truncation]
   end subroutine add_largest

   !> Creates a set and adds its tuples.
   subroutine add_set(union, truncation, has_improved, error)
      type(tuple_union_t), intent(inout) :: union
      type(truncation_t), intent(in) :: truncation
      logical, intent(in) :: has_improved                             !! with its wider set
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: set

      call truncation%make(set, error)
      if (allocated(error)) return
      call union%add(set%tuples)
      if (has_improved) call add_wider(union, set, error)
      call annotate(error, truncation%location)
   end subroutine add_set

   !> Adds the tuples of an improved motion that are not in its set.
   subroutine add_wider(union, set, error)
      type(tuple_union_t), intent(inout) :: union
      type(harmonics_t), intent(in) :: set
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: wider

      call choose_wider_set(set, wider, error)
      if (.not. allocated(error)) call union%add(wider%tuples)
   end subroutine add_wider

   !> The location that a message names.
   function location_of(point) result(location)
      integer, intent(in) :: point
      character(:), allocatable :: location

      location = "point "//to_text(point)//" of the sweep"
   end function location_of
end module hb_sweep_harmonics
