!> Reads models from documents: the order in which the groups are read, each by a procedure of its own. Numbers of the document
!> that change are set in the model (hb_model_numbers).
module hb_model_reader
   use hb_contact_parts, only: contact_parts_t                        ! gfortran 12 cannot write the module without it
   use hb_document, only: document_t, parameter_t
   use hb_element_reader, only: read_elements
   use hb_error, only: annotate, error_t
   use hb_floquet, only: floquet_t
   use hb_frequency_part, only: frequency_part_t
   use hb_frequency_part_input, only: read_frequency_part
   use hb_harmonics, only: new_harmonics
   use hb_kinds, only: wp
   use hb_memory_estimate, only: check_memory, sizes_of
   use hb_model, only: model_t
   use hb_model_laws, only: read_laws
   use hb_model_loads, only: loaded_tuples, read_initial, read_loads, read_starts
   use hb_model_number, only: follower_t, followers_of_changes, has_number, model_number_t, relation_t, values_at
   use hb_model_numbers, only: set_model_numbers
   use hb_model_settings, only: check_symmetry, read_accuracy, read_error_estimate, read_integration, read_output, read_sampling, &
      read_solver, read_stability
   use hb_model_tones, only: check_fundamentals, read_normal_mode, read_phase, read_tones
   use hb_number_paths, only: read_gradient, read_ties, reject_unknown_tones, store_ties
   use hb_options, only: callbacks_t, options_t, purpose_t
   use hb_parameter_number, only: locate_number
   use hb_point_budget, only: work_of_integration
   use hb_primary_method, only: primary_method
   use hb_properties, only: properties_t
   use hb_stability, only: stability_method
   use hb_structure_catalogue, only: read_structure
   use hb_system, only: system_t
   use hb_text, only: to_text
   use hb_truncation_reader, only: read_harmonics, read_lowest_set
   implicit none
   private
   public :: check_added, read_base, read_model, update_model

contains

   !> Reads a model. All problems of the input are collected in one message, one per line. Also fails if the model
   !> would need more memory than its key `memory_limit` or, if that is zero, `available` permits.
   subroutine read_model(self, document, error, available, callbacks, purpose)
      type(model_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available                     !! bytes for this process
      type(callbacks_t), intent(in), optional :: callbacks
      type(purpose_t), intent(in), optional :: purpose                !! of its motion; default: a point
      type(relation_t), allocatable :: relations(:)

      if (present(available)) self%options%memory_limit = available
      if (present(callbacks)) self%options%callbacks = callbacks
      if (present(purpose)) self%options%purpose = purpose
      call document%begin()
      call read_ties(document, relations)
      call read_parts(self, document, relations, error)
      if (allocated(error)) then
         call document%finish_early(error)
      else
         call document%finish(error)
      end if
      self%is_read = .not. allocated(error)
      if (self%is_read) call document%accept_changes()
   end subroutine read_model

   !> Reads what other groups are read on: the structure, the tones, and a set of harmonics. Fails with their problems.
   subroutine read_base(self, document, error, callbacks)
      type(model_t), intent(out) :: self
      type(document_t), intent(inout), target :: document             !! other groups in it are ignored
      type(error_t), allocatable, intent(out) :: error
      type(callbacks_t), intent(in) :: callbacks
      type(properties_t), pointer :: group

      self%options%callbacks = callbacks
      self%options%purpose%may_only_integrate = .true.
      call document%begin()
      call read_solver(self, document%optional_group("solver"))
      call document%required_group("structure", group, error)
      if (.not. allocated(error)) call read_structure(group, self%system%structure, error, self%options%memory_limit, &
                                                      self%options%callbacks%fe_models, self%system%builder)
      if (.not. allocated(error)) call read_tones_and_set(self, document, error)
      if (allocated(error)) then
         call document%finish_early(error)
      else
         call document%finish(error)
      end if
      self%is_read = .not. allocated(error)
   end subroutine read_base

   !> Reads the groups of a document that add something to a base, as far as they can be read without the other ones. Fails with
   !> their problems.
   subroutine check_added(base, document, error)
      type(model_t), intent(in) :: base
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: model

      model = base
      call document%begin()
      call read_added_structure(model, document, error)
      if (.not. allocated(error)) call read_set(model, document, error)
      if (.not. allocated(error)) call read_laws(model, document, error)
      if (allocated(error)) then
         call document%finish_early(error)
         return
      end if
      call read_loads(model, document)
      call read_starts(model, document)
      call read_initial(model, document)
      call document%finish(error)
   end subroutine check_added

   !> Updates a model that was read from a document to the present values of the document: numbers that have changed are
   !> set, anything else, an error included, makes the model be read again; `is_new` is then true.
   subroutine update_model(self, document, is_new, error, available, callbacks, purpose)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      logical, intent(out) :: is_new
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available                     !! bytes for this process
      type(callbacks_t), intent(in), optional :: callbacks             !! default: the previous ones
      type(purpose_t), intent(in), optional :: purpose                !! likewise
      type(callbacks_t) :: same
      type(purpose_t) :: same_purpose
      logical :: is_done

      is_done = self%is_read
      if (is_done) call set_changes(self, document, is_done)
      is_new = .not. is_done
      if (.not. is_new) return
      same = self%options%callbacks
      if (present(callbacks)) same = callbacks
      same_purpose = self%options%purpose
      if (present(purpose)) same_purpose = purpose
      call read_model(self, document, error, available, same, same_purpose)
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

      call read_solver(self, document%optional_group("solver"))
      call read_whole_structure(self, document, error)
      if (.not. allocated(error)) call read_tones_and_set(self, document, error)
      if (.not. allocated(error)) call read_laws(self, document, error)
      if (.not. allocated(error)) call check_rigid_laws(self%system, document)
      if (.not. allocated(error)) call read_settings(self, document)
      if (.not. allocated(error)) call read_grid_and_loads(self, document, error)
      if (allocated(error)) return
      call check_improvement(self%system, self%options, document%optional_group("error_estimate"))
      call read_conditions(self, document)
      call read_integration(self%options%integration, document%optional_group("integration"))
      call read_initial(self, document)
      call store_ties(self, document, relations)
      call read_gradient(self, document)
      if (.not. self%options%may_integrate) call reject_integration(self, document)
      self%options%integration%max_work = work_of_integration(self%system, self%options)
   end subroutine read_parts

   !> Reads the tones, and the set of harmonics with the accuracy for which it may be chosen.
   subroutine read_tones_and_set(self, document, error)
      type(model_t), intent(inout) :: self                            !! with its structure
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group

      self%options%may_integrate = .not. allocated(self%system%structure%parts)
      call read_tones(self%system%tones, document, error, may_be_absent=self%options%purpose%may_only_integrate)
      if (allocated(error)) return
      if (document%count("normal_mode") > 0 .and. .not. self%options%may_integrate) then
         group => document%group("normal_mode", 1)
         if (self%system%structure%depends_on_tuple()) then
            call group%problem_as_is(group%location()//": a sector has forced motions alone; leave out &normal_mode, or solve "// &
                                     "the whole wheel")
         else
            call group%problem_as_is(group%location()//": a normal mode has no stiffness that depends on the frequency; leave "// &
                                     "out &normal_mode")
         end if
      end if
      call check_sectors(self%system, document)
      call reject_unknown_tones(document, self%system%tones)
      if (self%system%tones%n_tones > 0) &
         call read_accuracy(self%options%accuracy, document, self%system%structure, self%system%tones%n_tones, &
                            self%options%purpose%is_followed)
      call read_set(self, document, error)
   end subroutine read_tones_and_set

   !> Reports elements that are for another number of tones, and more than one sector.
   subroutine check_sectors(system, document)
      type(system_t), intent(in) :: system
      type(document_t), intent(inout), target :: document
      type(properties_t), pointer :: group
      integer :: i

      if (.not. system%structure%depends_on_tuple()) return
      do i = 1, size(system%elements)
         associate (n => system%elements(i)%element%n_tones())
            if (n < 0) cycle
            group => document%group("sector", system%elements(i)%i)
            if (n /= system%tones%n_tones) &
               call group%problem("engine_orders", "one for each of the "//to_text(system%tones%n_tones)//" tones is needed")
            if (any(system%tones%is_unknown)) &
               call group%problem("engine_orders", "a sector needs given frequencies; solve the whole wheel for unknown ones")
            if (system%elements(i)%i > 1) call group%problem("low", "only one group &sector is possible; name all pairs in it")
         end associate
      end do
   end subroutine check_sectors

   !> Reports rigid laws that act on a degree of freedom and its copy in the next sector: in some harmonics both move together, so
   !> that no force changes their distance.
   subroutine check_rigid_laws(system, document)
      type(system_t), intent(in) :: system
      type(document_t), intent(inout), target :: document
      type(properties_t), pointer :: group
      logical :: is_used(system%structure%n_dofs)
      integer :: i, k

      if (.not. system%structure%depends_on_tuple()) return
      do i = 1, size(system%laws)
         if (.not. system%laws(i)%law%is_multiplier) cycle
         is_used = .false.
         is_used(system%laws(i)%law%dofs) = .true.
         do k = 1, size(system%elements)
            if (size(system%elements(k)%element%wanted_dofs(system%structure, is_used)) == 0) cycle
            group => document%group("law", system%law_groups(i))
            call group%problem("type", "a rigid law between a degree of freedom of 'low' and its copy in 'high' is not "// &
                               "possible; use an elastic one")
         end do
      end do
   end subroutine check_rigid_laws

   !> Reads settings that belong to no other part.
   subroutine read_settings(self, document)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document

      call read_error_estimate(self%options%error_estimate, document%optional_group("error_estimate"))
      if (.not. allocated(self%options%callbacks%stability_finder)) &
         allocate (self%options%callbacks%stability_finder, source=floquet_t())
      call read_stability(self%options%stability, document%optional_group("stability"), &
                          is_patient=self%options%purpose%is_followed .and. self%system%tones%n_tones <= 2)
      call read_output(self, document%optional_group("output"))
   end subroutine read_settings

   !> Reads the grid, the loads and the first guess. Fails if the model would need too much memory: the loads determine whether
   !> motions are odd, and this the memory.
   subroutine read_grid_and_loads(self, document, error)
      type(model_t), intent(inout) :: self                            !! with its laws
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      logical :: has_tones                                            ! otherwise there is nothing but a time integration

      has_tones = self%system%tones%n_tones > 0
      if (has_tones) then
         call read_sampling(self, document%optional_group("sampling"))
         call check_size(self, document, error)
         if (allocated(error)) return
      end if
      call read_loads(self, document)
      call read_starts(self, document)
      if (.not. has_tones) return
      if (self%options%purpose%is_followed .and. size(self%system%laws) == 0 .and. .not. any(self%system%tones%is_unknown)) &
         call self%system%keep_loaded_dofs()
      call check_symmetry(self%system, self%discretisation, document%optional_group("harmonics"))
      call check_size(self, document, error)
   end subroutine read_grid_and_loads

   subroutine check_size(self, document, error)
      type(model_t), intent(in) :: self
      type(document_t), intent(in) :: document
      type(error_t), allocatable, intent(out) :: error

      call check_memory(sizes_of(self%system, self%discretisation, self%options), self%options%memory_limit, error)
      call annotate(error, document%file_name)
   end subroutine check_size

   !> Reads the conditions that belong to unknown frequencies.
   subroutine read_conditions(self, document)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document

      if (any(self%system%tones%is_unknown)) then
         call check_fundamentals(self%system, self%discretisation, document%optional_group("harmonics"))
         call read_phase(self, document%optional_group("phase"))
      end if
      if (document%count("normal_mode") > 0) call read_normal_mode(self, document%optional_group("normal_mode"))
   end subroutine read_conditions

   !> Reports what a key requests and parts that depend on the frequency have no equations for.
   subroutine reject_integration(self, document)
      type(model_t), intent(in) :: self
      type(document_t), intent(inout), target :: document
      character(*), parameter :: reason = &
         "'integration' is not available with &dynamic_stiffness, &sector, a delay of &feedback or frequencies of &bearing, "// &
         "which are defined in the frequency domain only"
      type(properties_t), pointer :: group

      group => document%optional_group("solver")
      if (self%options%start%from_integration) call group%problem("first_guess", reason)
      if (self%options%primary_method == primary_method%integration) call group%problem("primary_method", reason)
      group => document%optional_group("stability")
      if (self%options%stability%method == stability_method%integration .and. .not. has_determinants(self%system)) &
         call group%problem("method", reason)
   end subroutine reject_integration

   !> Whether the stability of a motion can be found without equations in time (hb_hill), for all parts that depend on frequency.
   pure logical function has_determinants(system) result(has)
      type(system_t), intent(in) :: system

      has = system%tones%n_tones == 1
      if (.not. allocated(system%structure%parts)) return
      has = has .and. all(system%structure%parts%is_known_growing())
   end function has_determinants

   !> Reads the set of harmonics: that of the input, or the first one of those that are chosen for a tolerance; none without tones.
   subroutine read_set(self, document, error)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group

      associate (set => self%discretisation%harmonics, symmetry => self%discretisation%symmetry, accuracy => self%options%accuracy)
         if (self%system%tones%n_tones == 0) then
            call reject_harmonics(document)
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

   !> Rejects what is given about harmonics of tones that there are not.
   subroutine reject_harmonics(document)
      type(document_t), intent(inout), target :: document
      character(10), parameter :: names(3) = [character(10) :: "harmonics", "accuracy", "sampling"]
      type(properties_t), pointer :: group
      integer :: i

      do i = 1, size(names)
         if (document%count(trim(names(i))) == 0) cycle
         group => document%group(trim(names(i)), 1)
         call group%problem_as_is(group%location()//": there are no harmonics without &tones; leave it out, or give &tones")
      end do
   end subroutine reject_harmonics

   !> Reads `&structure`, and all elements and `&dynamic_stiffness` into it; `error` stops the reading.
   subroutine read_whole_structure(self, document, error)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group

      call document%required_group("structure", group, error)
      if (allocated(error)) return
      call read_structure(group, self%system%structure, error, self%options%memory_limit, self%options%callbacks%fe_models, &
                          self%system%builder)
      if (.not. allocated(error)) call read_added_structure(self, document, error)
   end subroutine read_whole_structure

   !> Reads all that is added to a structure.
   subroutine read_added_structure(self, document, error)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(frequency_part_t) :: part
      type(frequency_part_t), allocatable :: parts(:)
      integer :: i

      call read_elements(document, self%system%structure, self%system%elements)
      if (document%count("dynamic_stiffness") == 0) return
      allocate (parts(0))
      do i = 1, document%count("dynamic_stiffness")
         call read_frequency_part(part, document%group("dynamic_stiffness", i), self%system%structure, error)
         if (allocated(error)) return
         if (allocated(part%acts)) parts = [parts, part]
      end do
      if (allocated(self%system%structure%parts)) parts = [parts, self%system%structure%parts]   ! those of elements are last
      call move_alloc(parts, self%system%structure%parts)
   end subroutine read_added_structure

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
end module hb_model_reader
