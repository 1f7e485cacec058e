!> The input of a session: a document without files, from a text or from groups and their values, which may be changed.
module hb_session_input
   use hb_document, only: document_t, new_document, parameter_t
   use hb_error, only: error_t, fail
   use hb_input_keys, only: input_groups, kind_of
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_reader, only: check_added, read_base
   use hb_namelist, only: read_namelist, write_complete_text
   use hb_options, only: callbacks_t
   use hb_parameter_path, only: split_index
   use hb_properties, only: properties_t
   use hb_property_values, only: value_t
   use hb_sweep_plan, only: read_sweep_plan, sweep_plan_t
   use hb_text, only: join, split, string_t, to_text
   implicit none
   private
   public :: session_input_t

   character(*), parameter :: base_groups(2) = [character(9) :: "structure", "tones"]   ! on which others are read

   !> A variable of this type needs the attribute `target`. Handles identify groups.
   type :: session_input_t
      type(document_t) :: document
      type(document_t), private :: base_groups                        ! the structure and the tones,
      type(model_t), private :: base                                  ! read,
      logical, private :: has_base = .false.                          ! and unchanged since
      integer, private :: n_former = 0                                ! handles of the documents before
   contains
      procedure :: clear => session_input_clear
      procedure :: read => session_input_read
      procedure :: add_group => session_input_add_group
      procedure :: remove_group => session_input_remove_group
      procedure :: check_handle => session_input_check_handle
      procedure :: find => session_input_find
      procedure :: set => session_input_set
      procedure :: locate => session_input_locate
      procedure :: check_group => session_input_check_group
      procedure :: complete => session_input_complete
      procedure :: has_groups => session_input_has_groups
      procedure :: check => session_input_check
   end type session_input_t

contains

   !> Removes all groups.
   subroutine session_input_clear(self, folder)
      class(session_input_t), intent(inout) :: self
      character(*), intent(in) :: folder                              !! of the files that groups name, "models/"; or empty
      type(error_t), allocatable :: none

      self%has_base = .false.
      self%n_former = self%n_former + self%document%groups%n_handles
      call new_document(self%document, folder)
      call self%document%expect_groups(input_groups(), none)
   end subroutine session_input_clear

   !> Reads the text of an input. Fails with all errors of its syntax.
   subroutine session_input_read(self, name, text, error)
      class(session_input_t), intent(inout), target :: self
      character(*), intent(in) :: name                                !! for messages
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error

      self%has_base = .false.
      self%n_former = self%n_former + self%document%groups%n_handles
      call read_namelist(self%document, name, text, error)
      if (.not. allocated(error)) call self%document%expect_groups(input_groups(), error)
   end subroutine session_input_read

   !> Adds a group without values.
   subroutine session_input_add_group(self, name, handle, error)
      class(session_input_t), intent(inout) :: self
      character(*), intent(in) :: name                                !! such as "law"
      integer, intent(out) :: handle
      type(error_t), allocatable, intent(out) :: error

      if (.not. allocated(self%document%groups%holders)) call self%clear("")
      call self%document%add_given(name, handle, error)
      if (allocated(error)) return
      handle = handle + self%n_former
      call note_base(self, handle)
   end subroutine session_input_add_group

   !> Removes a group.
   subroutine session_input_remove_group(self, handle, error)
      class(session_input_t), intent(inout) :: self
      integer, intent(in) :: handle
      type(error_t), allocatable, intent(out) :: error

      call self%check_handle(handle, error)
      if (allocated(error)) return
      call note_base(self, handle)
      call self%document%remove_group(position_of(self, handle))
   end subroutine session_input_remove_group

   !> Finds a key of a group, or one of its elements, that may be set to `n` values. Fails for a key that the group does not have,
   !> as far as it was read, and for a value that follows another.
   subroutine session_input_find(self, handle, key, n, parameter, error)
      class(session_input_t), intent(in) :: self
      integer, intent(in) :: handle
      character(*), intent(in) :: key                                 !! such as "gap" or "frequency(2)"
      integer, intent(in) :: n
      type(parameter_t), intent(out) :: parameter
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: name, text
      logical :: is_good

      call self%check_handle(handle, error)
      if (allocated(error)) return
      call split_index(key, name, parameter%element(1), parameter%element(2), is_good)
      if (.not. is_good) then
         call fail(error, "'"//key//"' is not a key such as 'gap' or 'frequency(2)'")
      else if (parameter%element(1) > 0 .and. n /= 1) then
         call fail(error, "'"//key//"' has one value, not "//to_text(n))
      end if
      if (allocated(error)) return
      parameter%i_group = position_of(self, handle)
      parameter%key = name
      associate (group => self%document%groups%holders(parameter%i_group)%group)
         if (group%reading > 0 .and. .not. group%has_key(name)) then
            call group%describe_unknown(name, text)
            call fail(error, "&"//group%name//": "//text)
            return
         end if
      end associate
      call self%document%reject_tied(parameter, key, error)
   end subroutine session_input_find

   !> Sets a key to values: reals, integers, logicals or texts; none: its default. Matrices are given by rows.
   subroutine session_input_set(self, parameter, values)
      class(session_input_t), intent(inout), target :: self
      type(parameter_t), intent(in) :: parameter
      class(*), intent(in) :: values(:)

      associate (group => self%document%groups%holders(parameter%i_group)%group)
         if (any(group%name == base_groups)) self%has_base = .false.
         if (size(values) == 0) then
            call self%document%remove(parameter)
         else if (size(values) > 1) then
            call group%set(parameter%key, values)
         else
            select type (values)
            type is (integer)
               call self%document%set(parameter, real(values(1), wp))
            type is (real(wp))
               call self%document%set(parameter, values(1))
            type is (logical)
               call group%content%replace(trim(parameter%key), [value_t(kind=kind_of%truth, number=merge(1.0_wp, 0.0_wp, &
                  values(1)), i=parameter%element(1), j=parameter%element(2))], group%has_changed)
            type is (string_t)
               call self%document%set(parameter, values(1)%value)
            end select
         end if
      end associate
   end subroutine session_input_set

   !> Finds the group of a value by its path, `law(stop)%gap`; one that occurs once is added if there is none. Fails if there is no
   !> such key, or if its value follows another.
   subroutine session_input_locate(self, path, handle, error)
      class(session_input_t), intent(inout) :: self
      character(*), intent(in) :: path
      integer, intent(out) :: handle
      type(error_t), allocatable, intent(out) :: error
      type(parameter_t) :: parameter

      handle = 0
      call self%document%resolve(path, parameter, error)
      if (allocated(error)) then
         error%message = "'"//path//"': "//error%message
         return
      end if
      call self%document%reject_unknown(parameter, path, error)
      if (.not. allocated(error)) call self%document%reject_tied(parameter, path, error)
      if (.not. allocated(error)) handle = self%n_former + self%document%groups%holders(parameter%i_group)%group%handle
   end subroutine session_input_locate

   !> Fails with what is wrong with a group by itself: the structure, or what is added to it and to the tones.
   subroutine session_input_check_group(self, handle, callbacks, error)
      class(session_input_t), intent(inout), target :: self
      integer, intent(in) :: handle
      type(callbacks_t), intent(in) :: callbacks
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: problems
      character(:), allocatable :: name
      integer :: position

      call self%check_handle(handle, error)
      if (allocated(error)) return
      position = position_of(self, handle)
      name = self%document%groups%holders(position)%group%name
      if (any(name == base_groups)) self%has_base = .false.
      if (.not. self%has_base) call read_document_base(self, callbacks, problems)
      if (all(name /= base_groups)) then
         call copy_group(self, position)
         if (self%has_base) then
            call check_added(self%base, self%base_groups, problems)
         else
            call self%base_groups%finish_early(problems)
         end if
         call self%base_groups%remove_group(self%base_groups%groups%n)
      end if
      if (allocated(problems)) call fail_with_lines_of(name, problems%message, error)
   end subroutine session_input_check_group

   !> Reads the structure and the tones of the document by themselves. Fails with their problems.
   subroutine read_document_base(self, callbacks, error)
      class(session_input_t), intent(inout), target :: self
      type(callbacks_t), intent(in) :: callbacks
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call new_document(self%base_groups, self%document%file_name)
      do i = 1, size(base_groups)
         if (self%document%is_given(trim(base_groups(i)))) &
            call copy_group(self, self%document%groups%position_of(trim(base_groups(i)), 1))
      end do
      call read_base(self%base, self%base_groups, error, callbacks)
      self%has_base = .not. allocated(error)
   end subroutine read_document_base

   !> Copies a group of the document, at a position, behind the structure and the tones.
   subroutine copy_group(self, position)
      class(session_input_t), intent(inout), target :: self
      integer, intent(in) :: position
      type(properties_t), pointer :: copy

      copy => self%base_groups%add(self%document%groups%holders(position)%group%name)
      copy%content = self%document%groups%holders(position)%group%content
   end subroutine copy_group

   !> Fails with the lines of a message that are about a group.
   subroutine fail_with_lines_of(name, message, error)
      character(*), intent(in) :: name, message
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: lines(:)
      type(string_t), allocatable :: found(:)
      integer :: i

      call split(message, new_line("a"), lines)
      allocate (found(0))
      do i = 1, size(lines)
         if (index(lines(i)%value, "&"//name) == 1) found = [found, lines(i)]
      end do
      if (size(found) > 0) call fail(error, join(found, new_line("a")))
   end subroutine fail_with_lines_of

   !> The input with all permitted keys and their present values. Groups &sweep and &curve are included.
   subroutine session_input_complete(self, text, only_given)
      class(session_input_t), intent(inout), target :: self
      character(:), allocatable, intent(out) :: text
      logical, intent(in), optional :: only_given                     !! without defaults, default false
      type(error_t), allocatable :: ignored
      type(document_t), target :: document
      type(sweep_plan_t) :: plan

      if (self%document%count("sweep") + self%document%count("curve") > 0) then
         document = self%document
         call read_sweep_plan(plan, document, ignored)
         call write_complete_text(document, text, only_given)
         return
      end if
      call write_complete_text(self%document, text, only_given)
   end subroutine session_input_complete

   !> Whether there is an input.
   pure logical function session_input_has_groups(self) result(has_groups)
      class(session_input_t), intent(in) :: self

      has_groups = self%document%groups%n > 0
   end function session_input_has_groups

   !> Fails if there is no input.
   subroutine session_input_check(self, error)
      class(session_input_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%has_groups()) call fail(error, "the model has no groups; add them, or read an input")
   end subroutine session_input_check

   !> Position of a group in the document; 0 if there is none with this handle.
   pure integer function position_of(self, handle)
      class(session_input_t), intent(in) :: self
      integer, intent(in) :: handle

      position_of = 0
      if (handle > self%n_former) position_of = self%document%groups%position_of_handle(handle - self%n_former)
   end function position_of

   !> Fails if no group has a handle.
   subroutine session_input_check_handle(self, handle, error)
      class(session_input_t), intent(in) :: self
      integer, intent(in) :: handle
      type(error_t), allocatable, intent(out) :: error

      if (position_of(self, handle) == 0) call fail(error, "no group has the handle "//to_text(handle)// &
         "; adding a group, or the search for a path, returns one, valid until the group is removed")
   end subroutine session_input_check_handle

   !> Notes that a group changes which others are read on.
   subroutine note_base(self, handle)
      class(session_input_t), intent(inout) :: self
      integer, intent(in) :: handle

      associate (group => self%document%groups%holders(position_of(self, handle))%group)
         if (any(group%name == base_groups)) self%has_base = .false.
      end associate
   end subroutine note_base
end module hb_session_input
