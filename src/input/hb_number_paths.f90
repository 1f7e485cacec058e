!> Reads the groups of an input that name numbers of the model by their paths: what follows what (`&tie`), and by what motions are
!> differentiated (`&gradient`).
module hb_number_paths
   use hb_document, only: document_t, parameter_t, tied_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_number, only: model_number_t, moving_groups, numbered_groups, relation_t, tie_t
   use hb_model_numbers, only: find_model_number
   use hb_model_tones, only: tone_of
   use hb_parameter_number, only: find_number, list_groups
   use hb_properties, only: properties_t
   use hb_response, only: new_response, response_t
   use hb_text, only: number_of, shown, string_t, to_text
   use hb_tones, only: tones_t
   implicit none
   private
   public :: not_in_set, read_gradient, read_ties, reject_unknown_tones, store_ties

   character(*), parameter :: not_in_set = "the set of harmonics does not have this tuple; raise the order of &harmonics"

contains

   !> Reads the ties of a document, which stores what follows what, and sets the values that follow, which are then read as any
   !> others. Invalid paths are reported as problems of their groups.
   subroutine read_ties(document, relations)
      type(document_t), intent(inout), target :: document
      type(relation_t), allocatable, intent(out) :: relations(:)
      type(properties_t), pointer :: group
      type(tied_t), allocatable :: ties(:)
      character(:), allocatable :: path
      real(wp) :: number
      logical :: is_given
      integer :: i, k, n

      if (allocated(document%ties)) deallocate (document%ties)
      n = document%count("tie")
      allocate (relations(n))
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
         call group%get("factor", relations(i)%factor)
         call group%get("offset", relations(i)%offset)
         if (ties(i)%parameter%i_group == 0 .or. ties(i)%to%i_group == 0) then
            deallocate (ties)
            return
         end if
         call document%number_at(ties(i)%to, number, is_given)
         if (.not. is_given) call group%problem("to", trim(absence_of(document, ties(i)%to)))
      end do
      do i = 2, n
         group => document%group("tie", i)
         if (any([(ties(k)%parameter%hides(ties(i)%parameter) .or. ties(i)%parameter%hides(ties(k)%parameter), k=1, i - 1)])) &
            call group%problem("parameter", "follows another value by an earlier &tie; leave one of them out")
      end do
      do i = 1, n
         if (any([(ties(n)%parameter%hides(ties(i)%to), n=i, size(ties))])) then
            group => document%group("tie", i)
            call group%problem("to", "follows another value by a later &tie, or by this one; put that before this one")
         end if
      end do
      call move_alloc(ties, document%ties)
      do i = 1, n
         call document%number_at(document%ties(i)%to, number, is_given)
         if (is_given) call document%set(document%ties(i)%parameter, relations(i)%at(number))
      end do
   end subroutine read_ties

   !> Stores the ties in the model, which follows them from now on.
   subroutine store_ties(self, document, relations)
      type(model_t), intent(inout) :: self
      type(document_t), intent(in) :: document
      type(relation_t), intent(in) :: relations(:)
      integer :: i

      allocate (self%system%ties(0))
      if (.not. allocated(document%ties)) return                      ! or they are wrong, which has been reported
      self%system%ties = [(tie_t(relation=relations(i)), i=1, size(relations))]
      do i = 1, size(relations)
         call find_number(document, document%ties(i)%to, self%system%ties(i)%to)
         call find_number(document, document%ties(i)%parameter, self%system%ties(i)%number)
      end do
   end subroutine store_ties

   !> Why a parameter has no number.
   pure function absence_of(document, parameter) result(text)
      type(document_t), intent(in) :: document
      type(parameter_t), intent(in) :: parameter
      character(60) :: text

      integer :: i_key

      text = "has no number in this input: give it one"
      associate (group => document%groups%holders(parameter%i_group)%group)
         i_key = group%content%names%find(trim(parameter%key))
         if (i_key > 0 .and. maxval(parameter%element) > 0) then
            associate (key => group%content%keys(i_key))
               if (allocated(key%numbers)) text = "is not there: the key has "//number_of(size(key%numbers), "number")
            end associate
         end if
         if (group%name /= "tones") return
         if (parameter%key == "frequency" .and. group%given("hertz")) text = "has no number in this input, which gives tones%hertz"
         if (parameter%key == "hertz" .and. group%given("frequency")) &
            text = "has no number in this input, which gives tones%frequency"
      end associate
   end function absence_of

   !> Why a parameter with a number is none of a model: it does not have the indices of an element.
   pure function index_problem(document, parameter) result(text)
      type(document_t), intent(in) :: document
      type(parameter_t), intent(in) :: parameter
      character(120) :: text
      integer :: n_columns, n_numbers

      text = "is not a number that can move: give all numbers of its list"
      n_columns = 0
      n_numbers = 0
      associate (content => document%groups%holders(parameter%i_group)%group%content, element => parameter%element)
         if (content%names%find(trim(parameter%key)) > 0) then
            associate (key => content%keys(content%names%find(trim(parameter%key))))
               if (allocated(key%numbers)) n_numbers = size(key%numbers)
               n_columns = key%row_length
            end associate
         end if
         if (n_numbers > n_columns .and. element(2) == 0) then
            associate (k => max(1, element(1)) - 1)
               text = "is an element of a matrix; write "//trim(parameter%key)//"("//to_text(k/n_columns + 1)//", "// &
                      to_text(modulo(k, n_columns) + 1)//")"
            end associate
         else if (n_numbers > 1 .and. n_numbers == n_columns .and. (element(1) == 0 .or. element(2) > 0)) then
            text = "is a list; its elements have one index, like "//trim(parameter%key)//"(2)"
         end if
      end associate
   end function index_problem

   !> Reads `&gradient`: the values with respect to which motions are differentiated, real numbers of the input.
   subroutine read_gradient(self, document)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(properties_t), pointer :: group
      type(error_t), allocatable :: error
      type(response_t), allocatable :: response
      type(string_t), allocatable :: paths(:)
      character(:), allocatable :: of
      integer :: i, n

      allocate (self%options%gradient%by(0), self%options%gradient%names(0))
      if (document%count("gradient") == 0) return
      group => document%optional_group("gradient")
      call group%get("by", paths)
      if (.not. allocated(paths)) return                              ! which has been reported
      if (self%system%normal_mode%has_energy) then
         call group%problem("by", "needs an 'amplitude' of the &normal_mode, not an 'energy'")
         return
      end if
      call group%get("of", of)
      if (len_trim(of) > 0) then
         allocate (response)
         call new_response(response, of, self%system%structure, self%system%tones%n_tones, error)
         if (.not. (allocated(error) .or. self%options%accuracy%grows_set .or. response%is_in(self%discretisation%harmonics))) &
            call fail(error, "'"//response%name//"': "//not_in_set)
         if (allocated(error)) call group%problem("of", error%message)
         if (.not. allocated(error)) call move_alloc(response, self%options%gradient%of)
         if (self%options%purpose%is_followed) &
            call group%problem("of", "is for points and sweeps; leave it out with &curve, along which all coefficients are "// &
                               "differentiated")
      end if
      deallocate (self%options%gradient%by, self%options%gradient%names)
      allocate (self%options%gradient%by(size(paths)), self%options%gradient%names(size(paths)))
      n = 0
      do i = 1, size(paths)
         call add_value(self, document, group, trim(adjustl(paths(i)%value)), n)
      end do
      self%options%gradient%by = self%options%gradient%by(:n)
      self%options%gradient%names = self%options%gradient%names(:n)
   end subroutine read_gradient

   !> Adds a value that may move to those of a gradient; an invalid path is reported as a problem of the key.
   subroutine add_value(self, document, group, path, n)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout) :: document
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: path
      integer, intent(inout) :: n                                     !! values so far
      type(error_t), allocatable :: error
      type(model_number_t) :: number
      type(parameter_t) :: parameter
      character(:), allocatable :: problem
      real(wp) :: value
      logical :: is_given, is_found

      call find_value(document, group, "by", path, parameter)
      if (parameter%i_group == 0) return
      problem = ""
      call document%reject_tied(parameter, path, error)
      call document%number_at(parameter, value, is_given)
      if (allocated(error)) then
         problem = error%message
      else if (.not. any(document%groups%holders(parameter%i_group)%group%name == moving_groups)) then
         problem = "is not a number of "//trim(list_groups(numbered_groups%may_move, "or"))
      else if (document%n_tones_of(parameter) > 1) then
         problem = "does not specify the tone; give one, such as '"//path//"(1)'"
      else if (.not. is_given) then
         associate (holder => document%groups%holders(parameter%i_group)%group)
            if (holder%has_key(trim(parameter%key))) problem = trim(absence_of(document, parameter))
            if (.not. holder%has_key(trim(parameter%key))) then
               call holder%describe_unknown(trim(parameter%key), problem)
               problem = "has an "//problem
            end if
         end associate
      else if (.not. document%is_real(parameter)) then
         problem = "is not a real number; only real numbers have derivatives"
      else if (document%groups%holders(parameter%i_group)%group%name == "tones") then
         if (self%system%tones%is_unknown(max(1, parameter%element(1)))) problem = "is unknown, not given"
      end if
      call find_number(document, parameter, number)
      call find_model_number(self, number, value, is_found)
      if (len(problem) == 0 .and. .not. is_found) problem = trim(index_problem(document, parameter))
      if (len(problem) > 0) then
         if (.not. allocated(error)) problem = "'"//trim(shown(path))//"' "//problem
         call group%problem("by", problem)
         return
      end if
      n = n + 1
      self%options%gradient%by(n) = number
      self%options%gradient%names(n) = path
   end subroutine add_value

   !> Finds the value of a path in a key; an invalid path is reported as a problem of the key.
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
      call group%problem(key, "'"//trim(shown(path))//"': "//error%message)
   end subroutine find_value

   !> Reports a problem for each tie of a value that cannot follow an unknown frequency.
   subroutine reject_unknown_tones(document, tones)
      type(document_t), intent(inout), target :: document
      type(tones_t), intent(in) :: tones
      type(properties_t), pointer :: group
      integer :: i

      if (.not. allocated(document%ties)) return
      do i = 1, size(document%ties)
         if (tone_of(document, i, tones) == 0) cycle
         if (any(document%groups%holders(document%ties(i)%parameter%i_group)%group%name == &
                 pack(numbered_groups%name, numbered_groups%may_follow_unknown))) cycle
         group => document%group("tie", i)
         call group%problem("parameter", "follows the frequency of an unknown tone, which only values of "// &
                            trim(list_groups(numbered_groups%may_follow_unknown, "and"))//" can")
      end do
   end subroutine reject_unknown_tones
end module hb_number_paths
