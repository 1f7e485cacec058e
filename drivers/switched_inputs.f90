!> The input of motions that leave a curve: with the doubled period at a period doubling, or with an additional tone at
!> a Neimark-Sacker point
!> bifurcation or at a graze with a loss of stability.
!> It is the complete input of the curve at the point, with other tones, harmonics and tuples, and with the point as
!> its origin: an ordinary input, whose run has its own result file. At a graze multipliers jump, and the motion there
!> does not determine the other motions: these are found by time integration, slightly beyond the graze.
module switched_inputs
   use hb_census_file, only: without_group
   use hb_curve_table, only: leaving_t
   use hb_document, only: document_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_model, only: model_t
   use hb_model_loads, only: groups_with_tuples
   use hb_model_reader, only: read_model
   use hb_namelist, only: write_complete_text
   use hb_options, only: purpose_t
   use hb_outcome, only: outcome
   use hb_point_kinds, only: beginning, curve_kinds, response_keys
   use hb_properties, only: properties_t
   use hb_run_callbacks, only: run_callbacks
   use hb_study, only: study_t
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: add_string, quote, string_t, to_text
   use hb_tones, only: tones_t
   use hb_truncation, only: truncation_t
   use hb_truncation_reader, only: read_truncation
   implicit none
   private
   public :: list_of, switched_input

   integer, parameter :: torus_orders(2, 2) = reshape([12, 7, 5, 3], [2, 2]) ! highest orders of the tones there and of the
                                                                      ! additional one; there one tone, or several

contains

   !> Returns text and overrides of the input. Fails if the other motions are not defined for the set or for a law of
   !> the curve.
   subroutine switched_input(study, plan, path, from, text, overrides, error)
      type(study_t), intent(in) :: study                              !! of the curve
      type(sweep_plan_t), intent(in) :: plan                          !! with the values along it
      character(*), intent(in) :: path                                !! of its result file
      type(leaving_t), intent(in) :: from
      character(:), allocatable, intent(out) :: text
      type(string_t), allocatable, intent(out) :: overrides(:)        !! path=value
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(properties_t), pointer :: group
      type(model_t) :: model
      character(:), allocatable :: key
      integer :: i, k
      logical :: is_torus                                             ! otherwise the period doubles

      is_torus = curve_kinds(from%kind)%begins == beginning%torus
      document = study%document
      call plan%apply(from%point, document)
      call read_model(model, document, error, study%available_memory, run_callbacks(), &
                      purpose_t(is_followed=allocated(plan%curve)))
      if (allocated(error)) return
      call write_complete_text(document, text)
      text = without_group(text, "sweep")
      allocate (overrides(0))
      call document%begin()
      if (curve_kinds(from%kind)%multipliers_jump .and. model%system%tones%n_tones > 1) then
         call fail(error, "the motion has several tones")
      else if (is_torus .and. model%options%lacks_impacts_of(model%system, outcome%impact)) then
         call fail(error, "motions with impacts that have an additional tone are found by time integration alone; use a &sweep "// &
                   "over '"//plan%curve%path//"'")
      else if (.not. is_torus .and. any([(model%system%laws(i)%law%n_phases > 0, i=1, size(model%system%laws))])) then
         call fail(error, "a law turns with a tone; give half of its frequency, twice its tuples, and a &start near the motion")
      end if
      if (.not. (allocated(error) .or. model%options%accuracy%grows_set)) & ! otherwise the origin has it
         call add_set(document, model%system%tones%n_tones, plan%curve%torus_order, is_torus, overrides, error)
      if (allocated(error)) return
      if (is_torus) then
         group => document%group("tones", 1)
         key = trim(merge("hertz    ", "frequency", group%given("hertz")))
         call add(overrides, "tones%"//key, frequencies_of(model%system%tones, key == "hertz")//"0.0")
         call add(overrides, "tones%unknown", unknowns_of(model%system%tones)//".true.")
         call add(overrides, "error_estimate%improvement_steps", "0")
      else
         call add(overrides, "tones%subharmonic", to_text(2*model%system%tones%subharmonic))
      end if
      call add(overrides, "harmonics%symmetry", "'none'")
      call add_samples_and_tuples(document, model%system%tones%n_tones, is_torus, overrides)
      if (is_torus .and. index(plan%curve%path, "(") == 0 .and. index(plan%curve%path, "tones%") == 1) &
         call add(overrides, "curve%parameter", quote(plan%curve%path//"(1)"))
      do k = 1, size(response_keys)
         associate (names => plan%curve%responses_of(k)%names)
            if (size(names) > 0) call add(overrides, "curve%"//trim(response_keys(k)), responses_text(names, is_torus))
         end associate
      end do
      if (curve_kinds(from%kind)%multipliers_jump) then
         call add(overrides, "solver%first_guess", "'integration'")
         call add(overrides, "curve%start", to_text(a_little_beyond(plan, from)))
      else
         call add(overrides, "curve%origin", quote(path))
         call add(overrides, "curve%origin_point", to_text(from%point - 1))
      end if
      call add(overrides, "curve%switch", ".false.")
   end subroutine switched_input

   !> Sets the harmonics of the other motions.
   subroutine add_set(document, n_tones, torus_order, is_torus, overrides, error)
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones, torus_order(:)
      logical, intent(in) :: is_torus
      type(string_t), allocatable, intent(inout) :: overrides(:)
      type(error_t), allocatable, intent(out) :: error
      type(truncation_t) :: truncation

      call read_truncation(truncation, document, n_tones, error)
      if (allocated(error)) return
      if (.not. allocated(truncation%order)) then
         call fail(error, "&harmonics set = 'list' does not define the other motions; use a box or a diamond")
      else if (is_torus .and. size(torus_order) == 2) then
         call add(overrides, "harmonics%order", list_of([spread(torus_order(1), 1, n_tones), torus_order(2)]))
         call add(overrides, "harmonics%set", "'box'")
      else if (is_torus .and. truncation%set == "box") then
         associate (highest => torus_orders(:, min(n_tones, 2)), order => truncation%order)
            call add(overrides, "harmonics%order", list_of(min([order, maxval(order)], &
                                                               [spread(highest(1), 1, n_tones), highest(2)])))
         end associate
      else if (.not. is_torus .and. truncation%set == "box") then
         call add(overrides, "harmonics%order", list_of(2*truncation%order))
      else if (.not. is_torus) then
         call add(overrides, "harmonics%order", to_text(2*truncation%order(1)))
      end if
      call add(overrides, "harmonics%odd_only", ".false.")
   end subroutine add_set

   !> Sets the samples of the grid and the tuples of loads and starts, for an additional tone or half the tone.
   subroutine add_samples_and_tuples(document, n_tones, is_torus, overrides)
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      logical, intent(in) :: is_torus
      type(string_t), allocatable, intent(inout) :: overrides(:)
      type(properties_t), pointer :: group
      integer, allocatable :: samples(:)
      integer :: i, k

      group => document%optional_group("sampling")
      samples = spread(0, 1, n_tones)
      call group%get("samples", samples)
      if (is_torus) then
         call add(overrides, "sampling%samples", list_of([samples, 0]))
      else
         call add(overrides, "sampling%samples", list_of(2*samples))
      end if
      do k = 1, size(groups_with_tuples)
         do i = 1, document%count(trim(groups_with_tuples(k)))
            group => document%group(trim(groups_with_tuples(k)), i)
            if (.not. group%has_key("tuple")) cycle
            if (allocated(samples)) deallocate (samples)
            call group%get("tuple", samples)
            call add(overrides, trim(groups_with_tuples(k))//"("//to_text(i)//")%tuple", list_of(taken_over(samples, is_torus)))
         end do
      end do
   end subroutine add_samples_and_tuples

   subroutine add(overrides, where, what)
      type(string_t), allocatable, intent(inout) :: overrides(:)
      character(*), intent(in) :: where, what

      call add_string(overrides, where//"="//what)
   end subroutine add

   !> A value on the side of contact, inside the range of the curve.
   pure real(wp) function a_little_beyond(plan, from) result(value)
      type(sweep_plan_t), intent(in) :: plan
      type(leaving_t), intent(in) :: from
      real(wp), parameter :: little = 0.01_wp                         ! of the range

      associate (graze => plan%curve_values(from%point), ends => [plan%curve%from, plan%curve%to])
         value = graze + sign(little*abs(ends(2) - ends(1)), plan%curve_values(from%beyond) - graze)
         value = min(max(value, minval(ends)), maxval(ends))
      end associate
   end function a_little_beyond

   !> A tuple in the set of the other motions.
   pure function taken_over(tuple, is_torus) result(other)
      integer, intent(in) :: tuple(:)
      logical, intent(in) :: is_torus
      integer, allocatable :: other(:)

      if (is_torus) then
         other = [tuple, 0]
      else
         other = 2*tuple
      end if
   end function taken_over

   !> The names of responses as values of a key.
   function responses_text(names, is_torus) result(text)
      type(string_t), intent(in) :: names(:)
      logical, intent(in) :: is_torus
      character(:), allocatable :: text
      integer :: i

      text = quote(response_text(names(1)%value, is_torus))
      do i = 2, size(names)
         text = text//", "//quote(response_text(names(i)%value, is_torus))
      end do
   end function responses_text

   !> The name of a response with its tuple in the set of the other motions.
   function response_text(name, is_torus) result(text)
      character(*), intent(in) :: name
      logical, intent(in) :: is_torus
      character(:), allocatable :: text
      integer :: bracket, i, status
      integer, allocatable :: tuple(:)

      text = name
      bracket = index(name, "(")
      if (bracket == 0) return
      allocate (tuple(1 + count([(name(i:i) == ",", i=bracket, len(name))])))
      read (name(bracket + 1:index(name, ")") - 1), *, iostat=status) tuple
      if (status == 0) text = name(:bracket)//list_of(taken_over(tuple, is_torus))//")"
   end function response_text

   !> The frequencies of the tones there as values of a key, each with a comma.
   function frequencies_of(tones, in_hertz) result(text)
      type(tones_t), intent(in) :: tones
      logical, intent(in) :: in_hertz                                 !! otherwise in rad/s
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, tones%n_tones
         text = text//to_text(tones%omega(i)*tones%subharmonic/merge(two_pi, 1.0_wp, in_hertz))//", "
      end do
   end function frequencies_of

   !> Which of them are unknown, likewise.
   function unknowns_of(tones) result(text)
      type(tones_t), intent(in) :: tones
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, tones%n_tones
         text = text//to_text(tones%is_unknown(i))//", "
      end do
   end function unknowns_of

   !> Formats numbers as the values of a key.
   pure function list_of(numbers) result(text)
      integer, intent(in) :: numbers(:)
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, size(numbers)
         if (i > 1) text = text//","
         text = text//to_text(numbers(i))
      end do
   end function list_of
end module switched_inputs
