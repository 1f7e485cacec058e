!> The input of a session: a document without files, from a text or from groups and numbers, whose values may be changed.
module hb_session_input
   use hb_document, only: document_t, new_document, parameter_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_namelist, only: read_namelist, set_text, write_complete_text
   use hb_properties, only: properties_t
   use hb_sweep_plan, only: read_sweep_plan, sweep_plan_t
   use hb_text, only: is_name, lower
   implicit none
   private
   public :: session_input_t

   character(*), parameter :: not_begun = "no input was begun; call nhbm_input_begin before"

   !> A variable of this type needs the attribute `target`.
   type :: session_input_t
      type(document_t) :: document
      type(parameter_t), allocatable :: parameters(:)                 !! resolved
      logical :: is_begun = .false.                                   !! from numbers; `end` ends it
      logical :: is_valid = .false.                                   !! a model was read from it without an error
   contains
      procedure :: forget => session_input_forget
      procedure :: read => session_input_read
      procedure :: begin => session_input_begin
      procedure :: add_group => session_input_add_group
      procedure :: set_text => session_input_set_text
      procedure :: set_values => session_input_set_values
      procedure :: end => session_input_end
      procedure :: set_key => session_input_set_key
      procedure :: find_parameter => session_input_find_parameter
      procedure :: set_parameter => session_input_set_parameter
      procedure :: complete => session_input_complete
      procedure :: check => session_input_check
   end type session_input_t

contains

   !> Forgets the resolved numbers of the previous input, and that it was valid.
   subroutine session_input_forget(self)
      class(session_input_t), intent(inout) :: self

      self%is_begun = .false.
      self%is_valid = .false.
      if (allocated(self%parameters)) deallocate (self%parameters)
      allocate (self%parameters(0))
   end subroutine session_input_forget

   !> Reads the text of an input. Fails with all errors of its syntax.
   subroutine session_input_read(self, name, text, error)
      class(session_input_t), intent(inout), target :: self
      character(*), intent(in) :: name                                !! for messages
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error

      call self%forget()
      call read_namelist(self%document, name, text, error)
   end subroutine session_input_read

   !> Begins an input without text: groups and their values follow, then `end`.
   subroutine session_input_begin(self)
      class(session_input_t), intent(inout) :: self

      call self%forget()
      call new_document(self%document)
      self%is_begun = .true.
   end subroutine session_input_begin

   !> Ends the input that was begun.
   subroutine session_input_end(self, error)
      class(session_input_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%is_begun) call fail(error, not_begun)
      self%is_begun = .false.
   end subroutine session_input_end

   !> Adds a group to the input that was begun. Later values belong to it.
   subroutine session_input_add_group(self, name, error)
      class(session_input_t), intent(inout), target :: self
      character(*), intent(in) :: name                                !! such as "law"
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group

      if (.not. self%is_begun) then
         call fail(error, not_begun)
      else if (.not. is_name(lower(name))) then
         call fail(error, "'"//name//"' is not the name of a group")
      else
         group => self%document%add(name)
      end if
   end subroutine session_input_add_group

   !> Sets a key of the last group to its values, reals, integers or logicals. Matrices are given by rows.
   subroutine session_input_set_values(self, key, values, error)
      class(session_input_t), intent(inout), target :: self
      character(*), intent(in) :: key
      class(*), intent(in) :: values(:)
      type(error_t), allocatable, intent(out) :: error

      call check_key(self, key, error)
      if (allocated(error)) return
      if (size(values) == 0) then
         call fail(error, "key '"//key//"' has no values")
      else
         call self%document%groups%holders(self%document%groups%n)%group%set(key, values)
      end if
   end subroutine session_input_set_values

   !> Sets a key of the last group to a text.
   subroutine session_input_set_text(self, key, text, error)
      class(session_input_t), intent(inout), target :: self
      character(*), intent(in) :: key, text
      type(error_t), allocatable, intent(out) :: error

      call check_key(self, key, error)
      if (.not. allocated(error)) call self%document%groups%holders(self%document%groups%n)%group%set(key, text)
   end subroutine session_input_set_text

   !> Fails unless the key can be set in the input that was begun.
   subroutine check_key(self, key, error)
      class(session_input_t), intent(in) :: self
      character(*), intent(in) :: key
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%is_begun) then
         call fail(error, not_begun)
      else if (self%document%groups%n == 0) then
         call fail(error, "there is no group for the key '"//key//"'; add one before")
      else if (.not. is_name(lower(key))) then
         call fail(error, "'"//key//"' is not a key")
      end if
   end subroutine check_key

   !> Sets the values of a key, `law(stop)%gap = 1e-3`.
   subroutine session_input_set_key(self, path, values, error)
      class(session_input_t), intent(inout) :: self
      character(*), intent(in) :: path, values                        !! as for `--set`
      type(error_t), allocatable, intent(out) :: error
      type(parameter_t) :: parameter

      call self%check(error)
      if (allocated(error)) return
      call self%document%resolve(path, parameter, error)
      if (.not. allocated(error)) then
         call self%document%refuse_unknown(parameter, path, error)
         if (allocated(error)) return
      end if
      call set_text(self%document, path, values, error)               ! refuses other paths and values
   end subroutine session_input_set_key

   !> Looks up a number by its path, once; returns its index in `parameters`.
   subroutine session_input_find_parameter(self, path, number, error)
      class(session_input_t), intent(inout) :: self
      character(*), intent(in) :: path
      integer, intent(out) :: number
      type(error_t), allocatable, intent(out) :: error
      type(parameter_t) :: parameter

      number = 0
      call self%check(error)
      if (allocated(error)) return
      call self%document%resolve(path, parameter, error)
      if (allocated(error)) then
         error%message = "'"//path//"': "//error%message
         return
      end if
      call self%document%refuse_unknown(parameter, path, error)
      if (allocated(error)) return
      self%parameters = [self%parameters, parameter]
      number = size(self%parameters)
   end subroutine session_input_find_parameter

   !> Sets a resolved number, in the unit of the input. The next solution reports errors of its value.
   subroutine session_input_set_parameter(self, number, value, error)
      class(session_input_t), intent(inout) :: self
      integer, intent(in) :: number                                   !! returned by `find_parameter`
      real(wp), intent(in) :: value
      type(error_t), allocatable, intent(out) :: error

      call self%check(error)
      if (allocated(error)) return
      if (number < 1 .or. number > size(self%parameters)) then
         call fail(error, "no parameter has this handle; the search for a path returns one, valid until another input is read")
         return
      end if
      associate (parameter => self%parameters(number))
         call self%document%refuse_tied(parameter, trim(parameter%key), error)
         if (.not. allocated(error)) call self%document%set(parameter, value)
      end associate
   end subroutine session_input_set_parameter

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

   !> Fails if there is no input.
   subroutine session_input_check(self, error)
      class(session_input_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%is_valid) call fail(error, "the model has no input; read one before")
   end subroutine session_input_check
end module hb_session_input
