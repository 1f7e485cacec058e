!> Reads models from documents: the permitted groups, and the order in which their procedures read them. Numbers of the
!> document that change are set in the model (hb_model_numbers).
module hb_model_reader
   use hb_document, only: document_t, parameter_t, tied_t
   use hb_element_reader, only: read_elements
   use hb_error, only: annotate, error_t
   use hb_floquet, only: floquet_t
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_frequency_part_input, only: read_frequency_part
   use hb_harmonics, only: new_harmonics
   use hb_kinds, only: wp
   use hb_memory_estimate, only: check_memory, sizes_of
   use hb_model, only: model_t
   use hb_model_laws, only: read_laws
   use hb_model_loads, only: loaded_tuples, read_initial, read_loads, read_starts
   use hb_model_number, only: follower_t, followers_of_changes, has_number, model_number_t, moving_groups, numbered_groups, &
      relation_t, tie_t, values_at
   use hb_model_numbers, only: find_model_number, set_model_numbers
   use hb_model_settings, only: check_symmetry, read_accuracy, read_error_estimate, read_integration, read_output, read_sampling, &
      read_solver, read_stability
   use hb_model_tones, only: check_fundamentals, read_normal_mode, read_phase, read_tones, tone_of
   use hb_options, only: callbacks_t, options_t
   use hb_parameter_number, only: find_number, list_groups, locate_number
   use hb_properties, only: properties_t
   use hb_response, only: new_response, response_t
   use hb_solver_types, only: share_of_solver
   use hb_stability, only: stability_method
   use hb_structure_catalogue, only: read_structure
   use hb_system, only: system_t
   use hb_text, only: number_of, shown, string_t, to_text
   use hb_time_domain, only: primary_method
   use hb_tones, only: tones_t
   use hb_truncation_reader, only: read_harmonics, read_lowest_set
   implicit none
   private
   public :: read_model, update_model

   real(wp), parameter :: work_of_method = 0.5_wp*(1.0_wp/share_of_solver - 1.0_wp)   ! of time integration, relative to that
                                                                      ! of the solver's fallbacks; two methods share
                                                                      ! the rest
   real(wp), parameter :: work_if_requested = 19.0e9_wp               ! of a method, if time integration is no fallback
   real(wp), parameter :: min_work = 0.5e9_wp                         ! of a method, at each point of a sweep

contains

   !> Reads a model. All problems of the input are collected in one message, one per line. Also fails if the model
   !> would need more memory than its key `memory_limit` or, if that is zero, `available` permits.
   subroutine read_model(self, document, error, available, callbacks)
      type(model_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available                     !! bytes for this process
      type(callbacks_t), intent(in), optional :: callbacks
      type(relation_t), allocatable :: relations(:)

      if (present(available)) self%options%memory_limit = available
      if (present(callbacks)) self%options%callbacks = callbacks
      call document%begin()
      call read_ties(document, relations)
      call read_parts(self, document, relations, error)
      if (.not. allocated(error)) call document%finish(error)
      self%is_read = .not. allocated(error)
      if (self%is_read) call document%accept_changes()
   end subroutine read_model

   !> Updates a model that was read from a document to the present values of the document: numbers that have changed are
   !> set, anything else, an error included, makes the model be read again; `is_new` is then true.
   subroutine update_model(self, document, is_new, error, available, callbacks)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      logical, intent(out) :: is_new
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available                     !! bytes for this process
      type(callbacks_t), intent(in), optional :: callbacks             !! default: the previous ones
      type(callbacks_t) :: same
      logical :: is_done

      is_done = self%is_read
      if (is_done) call set_changes(self, document, is_done)
      is_new = .not. is_done
      if (.not. is_new) return
      same = self%options%callbacks
      if (present(callbacks)) same = callbacks
      call read_model(self, document, error, available, same)
   end subroutine update_model

   !> Sets the numbers of a document that have changed, and those that follow them, in the model and in the document. `is_done` is
   !> false if something else has changed, or if a reader must decide: whether a number is possible, or changes more than numbers
   !> of the model.
   subroutine set_changes(self, document, is_done)
      type(model_t), intent(inout) :: self                            !! as it was read from the document
      type(document_t), intent(inout) :: document
      logical, intent(out) :: is_done
      type(error_t), allocatable :: error
      type(follower_t), allocatable :: moving(:)
      type(model_number_t), allocatable :: numbers(:)
      type(parameter_t), allocatable :: changes(:)
      real(wp), allocatable :: values(:)
      integer :: i

      call document%adopt_changes(changes)
      is_done = .not. document%has_changed()
      if (.not. is_done .or. size(changes) == 0) return
      allocate (numbers(size(changes)), values(size(changes)))
      do i = 1, size(changes)
         call locate_number(document, changes(i), numbers(i))
         is_done = numbers(i)%object /= has_number%none
         if (is_done .and. self%system%normal_mode%has_energy) is_done = numbers(i)%object == has_number%normal_mode ! check_energy
         if (is_done) call document%number_at(changes(i), values(i), is_done)
         if (.not. is_done) return
      end do
      moving = followers_of_changes(self%system%ties, numbers, values)
      values = values_at(moving, 0.0_wp)
      call set_model_numbers(self, moving%number, values, error, is_alike=is_done)
      is_done = is_done .and. .not. allocated(error)
      if (.not. is_done) return
      do i = 1, size(moving)
         if (moving(i)%tie == 0) call note_number(document, changes(i), values(i))
         if (moving(i)%tie == 0) cycle
         call document%set(document%ties(moving(i)%tie)%parameter, values(i))
         call note_number(document, document%ties(moving(i)%tie)%parameter, values(i))
      end do
      call document%accept_changes()
   end subroutine set_changes

   !> Stores the number that the model has for a parameter of a document.
   pure subroutine note_number(document, parameter, value)
      type(document_t), intent(inout) :: document
      type(parameter_t), intent(in) :: parameter
      real(wp), intent(in) :: value

      associate (group => document%groups%holders(parameter%i_group)%group)
         call group%note_number(trim(parameter%key), parameter%element, value)
      end associate
   end subroutine note_number

   !> Tuples of loads, first guesses and outputs with a requested accuracy, (n_tones, any).
   function wanted_tuples(system, options, document) result(tuples)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(document_t), intent(inout), target :: document
      integer, allocatable :: tuples(:, :)
      integer, allocatable :: entries(:)
      integer :: i

      associate (outputs => options%accuracy%outputs, n_tones => system%tones%n_tones)
         allocate (entries, source=[loaded_tuples(document, n_tones)])
         do i = 1, size(outputs)
            if (allocated(outputs(i)%tuple)) entries = [entries, outputs(i)%tuple]
         end do
         tuples = reshape(entries, [n_tones, size(entries)/n_tones])
      end associate
   end function wanted_tuples

   !> Reads the groups in order; `error` stops the reading, problems of single keys are collected in the document.
   subroutine read_parts(self, document, relations, error)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(relation_t), intent(in) :: relations(:)                    !! of its ties
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      logical :: has_tones                                            ! otherwise there is nothing but a time integration

      call read_solver(self, document%optional_group("solver"))
      call read_whole_structure(self, document, error)
      if (allocated(error)) return
      self%options%may_integrate = document%count("dynamic_stiffness") == 0
      call read_tones(self%system%tones, document, error, may_be_absent=self%options%callbacks%may_only_integrate)
      if (allocated(error)) return
      has_tones = self%system%tones%n_tones > 0
      if (.not. self%options%may_integrate .and. document%count("normal_mode") > 0) then
         group => document%group("dynamic_stiffness", 1)
         call group%problem("type", "a normal mode has no stiffness that depends on the frequency; leave out &normal_mode")
      end if
      call refuse_unknown_tones(document, self%system%tones)
      if (has_tones) call read_accuracy(self%options%accuracy, document, self%system%structure, self%system%tones%n_tones, &
                                        self%options%callbacks%is_followed)
      call read_set(self, document, error)
      if (allocated(error)) return
      call read_laws(self, document, error)
      if (allocated(error)) return
      call read_error_estimate(self%options%error_estimate, document%optional_group("error_estimate"))
      if (.not. allocated(self%options%callbacks%stability_finder)) &
         allocate (self%options%callbacks%stability_finder, source=floquet_t())
      call read_stability(self%options%stability, document%optional_group("stability"), &
                          is_patient=self%options%callbacks%is_followed .and. self%system%tones%n_tones == 1)
      call read_output(self, document%optional_group("output"))
      if (has_tones) then
         call read_sampling(self, document%optional_group("sampling"))
         call check_size()
         if (allocated(error)) return
      end if
      call read_loads(self, document)
      call read_starts(self, document)
      if (has_tones) then
         call check_symmetry(self%system, self%discretisation, document%optional_group("harmonics"))
         call check_size()                                            ! again: loads determine whether motions are odd
      end if
      if (allocated(error)) return
      call check_improvement(self%system, self%options, document%optional_group("error_estimate"))
      if (any(self%system%tones%is_unknown)) then
         call check_fundamentals(self%system, self%discretisation, document%optional_group("harmonics"))
         call read_phase(self, document%optional_group("phase"))
      end if
      if (document%count("normal_mode") > 0) call read_normal_mode(self, document%optional_group("normal_mode"))
      call read_integration(self%options%integration, document%optional_group("integration"))
      call read_initial(self, document)
      call store_ties(self, document, relations)
      call read_gradient(self, document)
      if (.not. self%options%may_integrate) call refuse_integration()
      self%options%integration%max_work = work_of_integration(self%system, self%options)

   contains

      !> What a key requests and a &dynamic_stiffness has no equations for.
      subroutine refuse_integration()
         character(*), parameter :: reason = &
            "'integration' is not available with &dynamic_stiffness, which is defined in the frequency domain only"

         group => document%optional_group("solver")
         if (self%options%start%from_integration) call group%problem("first_guess", reason)
         if (self%options%primary_method == primary_method%integration) call group%problem("primary_method", reason)
         group => document%optional_group("stability")
         if (self%options%stability%method == stability_method%integration .and. .not. has_determinants()) &
            call group%problem("method", reason)
      end subroutine refuse_integration

      !> Whether the stability of a motion with these parts can be found without equations in time (hb_hill).
      pure logical function has_determinants() result(has)
         integer :: i

         has = self%system%tones%n_tones == 1
         if (.not. allocated(self%system%structure%parts)) return
         do i = 1, size(self%system%structure%parts)
            has = has .and. any(self%system%structure%parts(i)%kind == [kind_of_part%delay, kind_of_part%maxwell])
         end do
      end function has_determinants

      subroutine check_size()
         call check_memory(sizes_of(self%system, self%discretisation, self%options), self%options%memory_limit, error)
         call annotate(error, document%file_name)
      end subroutine check_size
   end subroutine read_parts

   !> Reads the set of harmonics: that of the input, or the first one of those that are chosen for a tolerance; none without tones.
   subroutine read_set(self, document, error)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group

      associate (set => self%discretisation%harmonics, symmetry => self%discretisation%symmetry, accuracy => self%options%accuracy)
         if (self%system%tones%n_tones == 0) then
            call refuse_harmonics(document)
            call new_harmonics(set, reshape([integer ::], [0, 1]), error)
         else if (accuracy%grows_set) then
            call read_lowest_set(set, document, wanted_tuples(self%system, self%options, document), error, symmetry)
            if (allocated(error) .or. set%n_harmonics <= accuracy%max_harmonics) return
            group => document%optional_group("accuracy")
            call group%problem("max_harmonics", "must be "//to_text(set%n_harmonics)//" or more, the initial tuples")
         else
            call read_harmonics(set, document, self%system%tones%n_tones, error, symmetry)
         end if
      end associate
   end subroutine read_set

   !> Largest work of one method of time integration.
   real(wp) function work_of_integration(system, options) result(work)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options

      work = work_of_method*options%solver%max_fallback_work
      if (options%solver%has_max_fallback_work) return
      if (options%primary_method == primary_method%integration .or. (system%tones%n_tones > 1 .and. &
                                                                     system%has_restitution(options%integration%restitution))) &
         work = work_if_requested                                     ! of one tone the period map finds a motion with impacts
      work = max(options%callbacks%share_of_integration*work, min_work)
   end function work_of_integration

   !> Rejects what is given about harmonics of tones that there are not.
   subroutine refuse_harmonics(document)
      type(document_t), intent(inout), target :: document
      character(10), parameter :: names(3) = [character(10) :: "harmonics", "accuracy", "sampling"]
      type(properties_t), pointer :: group
      integer :: i

      do i = 1, size(names)
         if (document%count(trim(names(i))) == 0) cycle
         group => document%group(trim(names(i)), 1)
         call group%problem_as_is(group%location()//": there are no harmonics without &tones; leave it out, or give &tones")
      end do
   end subroutine refuse_harmonics

   !> Reads `&structure`, and all `&bearing` and `&dynamic_stiffness` into it; `error` stops the reading.
   subroutine read_whole_structure(self, document, error)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(frequency_part_t) :: part
      type(frequency_part_t), allocatable :: parts(:)
      type(properties_t), pointer :: group
      integer :: i

      call document%required_group("structure", group, error)
      if (allocated(error)) return
      call read_structure(group, self%system%structure, error, self%options%memory_limit, self%options%callbacks%fe_models, &
                          self%system%builder)
      if (allocated(error)) return
      call read_elements(document, self%system%structure, self%system%elements)
      if (document%count("dynamic_stiffness") == 0) return
      allocate (parts(0))
      do i = 1, document%count("dynamic_stiffness")
         call read_frequency_part(part, document%group("dynamic_stiffness", i), self%system%structure, error)
         if (allocated(error)) return
         if (allocated(part%acts)) parts = [parts, part]
      end do
      call move_alloc(parts, self%system%structure%parts)
   end subroutine read_whole_structure

   !> Checks that sets and tones are given, as improvement steps require.
   subroutine check_improvement(system, options, group)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(properties_t), intent(inout) :: group                      !! &error_estimate

      if (options%error_estimate%improvement_steps <= 0) return
      if (options%accuracy%is_on) call group%problem("improvement_steps", &
         "needs a given set: give &harmonics order and leave out &accuracy, or leave it out")
      if (any(system%tones%is_unknown)) call group%problem("improvement_steps", "requires given tones; leave it out")
   end subroutine check_improvement

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
      integer :: i, n

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
         if (allocated(error)) call group%problem("of", error%message)
         if (.not. allocated(error)) call move_alloc(response, self%options%gradient%of)
         if (self%options%callbacks%is_followed) &
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
      call document%refuse_tied(parameter, path, error)
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
            if (.not. holder%has_key(trim(parameter%key))) call holder%describe_unknown(trim(parameter%key), problem)
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
      call group%problem(key, "'"//trim(shown(path))//"' "//error%message)
   end subroutine find_value

   !> Reports a problem for each tie of a value that cannot follow an unknown frequency.
   subroutine refuse_unknown_tones(document, tones)
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
   end subroutine refuse_unknown_tones
end module hb_model_reader
