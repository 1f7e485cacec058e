!> An input that is ready to run: its document, the plan of its sweep, the model of its first point, the harmonics of
!> all points, and the layout of its result file.
module hb_study
   use hb_chained_points, only: is_chained
   use hb_coordinates, only: coordinates_t
   use hb_curve_request, only: curve_request_t
   use hb_document, only: document_t, parameter_t
   use hb_error, only: annotate, error_t, fail
   use hb_input_keys, only: input_groups
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_reader, only: read_model
   use hb_model_tones, only: read_tones
   use hb_named_files, only: reject_other_libraries
   use hb_namelist, only: read_namelist, set_text, write_complete_text
   use hb_operating_system, only: folder_of
   use hb_options, only: callbacks_t, purpose_t, share_of_integrated
   use hb_outcome, only: outcome
   use hb_result_columns, only: measure_row, new_plan, plan_t
   use hb_results_layout, only: results_layout_t
   use hb_run_callbacks, only: run_callbacks
   use hb_stability, only: n_multipliers_of, stability_method
   use hb_stored_origin, only: request_curve
   use hb_structure_load, only: is_random
   use hb_sweep_harmonics, only: tuples_of_sweep
   use hb_sweep_plan, only: read_sweep_plan, sweep_plan_t
   use hb_swept_point, only: note_dofs
   use hb_system, only: coordinates_of, system_t
   use hb_text, only: join, string_t, to_text
   use hb_tones, only: tones_t
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: describe_layout, new_study, read_input, row_of_study, study_t

   !> An input without errors, ready to run.
   type :: study_t
      type(document_t) :: document                                    !! the input after overrides, with the values of `model`
      type(sweep_plan_t) :: plan
      type(model_t) :: model                                          !! of the first point, after a run of the last one
      integer, allocatable :: tuples(:, :)                            !! union of the sets of all points, (n_tones, any)
      character(:), allocatable :: input_text                         !! the input as given
      character(:), allocatable :: input_overrides                    !! path=value, one per line
      character(:), allocatable :: input_complete                     !! the input after defaults
      real(wp) :: available_memory = huge(1.0_wp)                     !! bytes for this process
      type(callbacks_t) :: callbacks                                   !! for the models of its points
      type(purpose_t) :: purpose                                       !! of their motions
   contains
      procedure :: libraries => study_libraries
      procedure :: n_chains => study_n_chains
      procedure :: read_point => study_read_point
   end type study_t

contains

   !> Reads the text of an input file with its overrides; fails with all problems of the first point and of the sweep.
   subroutine new_study(self, file_name, text, overrides, error, available_memory, may_only_integrate, files)
      type(study_t), intent(out), target :: self
      character(*), intent(in) :: file_name                           !! for messages
      character(*), intent(in) :: text
      type(string_t), intent(in) :: overrides(:)                      !! path=value, as in --set
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available_memory              !! bytes for this process, the same on all ranks
      logical, intent(in), optional :: may_only_integrate             !! see `purpose_t`; default: false
      character(*), intent(in), optional :: files                     !! of the run whose result file contains the input: no other
                                                                      !! library is loaded
      type(curve_request_t), allocatable :: request
      type(tones_t) :: tones

      if (present(available_memory)) self%available_memory = available_memory
      self%input_text = text
      self%input_overrides = join(overrides, new_line("a"))
      call read_input(self%document, file_name, text, overrides, error)
      if (present(files) .and. .not. allocated(error)) call reject_other_libraries(self%document, files, error)
      if (allocated(error)) return
      call read_sweep_plan(self%plan, self%document, error)
      if (allocated(error)) return
      if (allocated(self%plan%curve)) then
         call read_tones(tones, self%document, error)
         if (allocated(error)) return
         call self%plan%curve%tie_tones(self%document, tones%omega, error)
         if (allocated(error)) return
      end if
      call self%plan%apply(1, self%document)
      self%callbacks = run_callbacks(self%plan%n_expected(), allocated(self%plan%curve))
      self%purpose%is_followed = allocated(self%plan%curve)
      if (present(may_only_integrate)) self%purpose%may_only_integrate = may_only_integrate
      call read_model(self%model, self%document, error, self%available_memory, self%callbacks, self%purpose)
      if (.not. allocated(error)) call self%plan%reject_tied(self%document, error)
      if (.not. allocated(error)) call reject_hidden(self%plan, self%document, overrides, error)
      if (allocated(error)) return
      call self%plan%note_units(self%document)
      if (allocated(self%plan%curve)) then
         allocate (request)
         call request_curve(self%plan%curve, self%model, self%document, request, error)
         if (allocated(error)) return
      end if
      if (is_chained(self%plan, self%model)) call begin_chains()
      if (allocated(error)) return
      call write_complete_text(self%document, self%input_complete)
      call find_tuples(self, error)

   contains

      !> Each point starts from its neighbour: the model is read again with this setting.
      subroutine begin_chains()
         call set_text(self%document, "solver%first_guess", "'neighbour'", error)
         if (.not. allocated(error)) &
            call read_model(self%model, self%document, error, self%available_memory, self%callbacks, self%purpose)
      end subroutine begin_chains
   end subroutine new_study

   !> Finds the tuples of the result file: those of the sets of all points, or room for as many as a set may choose.
   subroutine find_tuples(self, error)
      type(study_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      associate (model => self%model)
         if (model%system%tones%n_tones == 0) then
            self%tuples = model%discretisation%harmonics%tuples
         else if (model%options%accuracy%grows_set) then
            allocate (self%tuples(model%system%tones%n_tones, share_of_integrated*model%options%accuracy%max_harmonics), source=0)
         else
            call tuples_of_sweep(self%tuples, model%discretisation%harmonics, self%plan, self%document, has_improved(self), error)
         end if
      end associate
   end subroutine find_tuples

   !> Reads the model of a point.
   subroutine study_read_point(self, point, model, error)
      class(study_t), intent(in) :: self
      integer, intent(in) :: point                                    !! from 1
      type(model_t), intent(out) :: model
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document

      document = self%document
      call self%plan%apply(point, document)
      call read_model(model, document, error, self%available_memory, self%callbacks, self%purpose)
      call annotate(error, "point "//to_text(point)//" ("//self%plan%describe(point)//")")
   end subroutine study_read_point

   !> Number of chains of points; 0 if each point starts alone.
   pure integer function study_n_chains(self) result(n)
      class(study_t), intent(in) :: self

      n = 0
      associate (line => self%plan%n_fastest(), length => self%model%options%chain%length)
         if (self%model%options%chain%is_on) n = (self%plan%n_points/line)*((line + length - 1)/length)
      end associate
   end function study_n_chains

   !> Parses the text of an input file and applies its overrides.
   subroutine read_input(document, file_name, text, overrides, error)
      type(document_t), intent(out) :: document
      character(*), intent(in) :: file_name                           !! for messages
      character(*), intent(in) :: text
      type(string_t), intent(in) :: overrides(:)                      !! path=value
      type(error_t), allocatable, intent(out) :: error

      call read_namelist(document, file_name, text, error)
      if (allocated(error)) return
      call document%expect_groups(input_groups(), error)
      if (.not. allocated(error)) call apply_overrides(document, overrides, error)
   end subroutine read_input

   !> Applies overrides in turn, each path=value.
   subroutine apply_overrides(document, overrides, error)
      type(document_t), intent(inout) :: document
      type(string_t), intent(in) :: overrides(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      do i = 1, size(overrides)
         call apply_override(document, overrides(i)%value, error)
         if (allocated(error)) return
      end do
   end subroutine apply_overrides

   !> Rejects an override without effect, because a sweep, a curve or a tie gives the same key other values.
   subroutine reject_hidden(plan, document, overrides, error)
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(inout) :: document
      type(string_t), intent(in) :: overrides(:)                      !! path=value
      type(error_t), allocatable, intent(out) :: error
      type(parameter_t) :: parameter
      integer :: i, k

      do i = 1, size(overrides)
         associate (path => overrides(i)%value(:index(overrides(i)%value, "=") - 1))
            call document%resolve(path, parameter, error)
            if (allocated(error)) return
            do k = 1, size(plan%parameters)
               if (.not. plan%parameters(k)%parameter%hides(parameter)) cycle
               call fail(error, "--set "//trim(adjustl(path))//": no point would have this value, "//plan%parameters(k)%location// &
                  " sweeps "//plan%parameters(k)%path//"; change the sweep, such as --set 'sweep("//to_text(k)//")%values=...'")
               return
            end do
            if (allocated(plan%curve)) then
               if (plan%curve%parameter%hides(parameter)) then
                  call fail(error, "--set "//trim(adjustl(path))//": no point would have this value, &curve varies "// &
                            plan%curve%path//"; change its range, such as --set curve%from=...")
                  return
               end if
            end if
            call document%reject_tied(parameter, trim(adjustl(path)), error)
            if (allocated(error)) return
         end associate
      end do
   end subroutine reject_hidden

   !> Applies one `path=value`; without a value the key is removed.
   subroutine apply_override(document, text, error)
      type(document_t), intent(inout) :: document
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      type(parameter_t) :: parameter
      integer :: equals

      equals = index(text, "=")
      if (equals < 2) then
         call fail(error, "--set needs path=value, such as law(1)%gap=1.5e-3, not '"//text//"'")
         return
      else if (index(text, new_line("a")) > 0) then
         call fail(error, "--set needs path=value in one line")
         return
      end if
      if (len_trim(text(equals + 1:)) > 0) then
         call set_text(document, trim(adjustl(text(:equals - 1))), text(equals + 1:), error)
      else
         call document%resolve(text(:equals - 1), parameter, error)
         if (allocated(error)) error%message = "'"//trim(adjustl(text(:equals - 1)))//"': "//error%message
         if (.not. allocated(error)) call document%remove(parameter)
      end if
      call annotate(error, trim(merge("--set  ", "--unset", len_trim(text(equals + 1:)) > 0)))
   end subroutine apply_override

   !> Whether improved motions are stored; determined by the first point.
   pure logical function has_improved(self)
      type(study_t), intent(in) :: self

      has_improved = self%model%options%error_estimate%is_on .and. self%model%options%error_estimate%improvement_steps > 0
   end function has_improved

   !> Describes the contents of the result file before the first point is solved.
   subroutine describe_layout(self, n_ranks, layout, n_harmonics)
      type(study_t), intent(in) :: self
      integer, intent(in) :: n_ranks
      type(results_layout_t), intent(out) :: layout
      integer, intent(in), optional :: n_harmonics                    !! for harmonics; default: all
      integer :: i, k

      call describe_rows(self, n_ranks, layout, n_harmonics)
      associate (plan => self%plan)
         do i = 1, size(plan%parameters)
            if (plan%parameters(i)%is_text) then
               allocate (layout%parameters(i)%text_values(plan%n_points))
               do k = 1, plan%n_points
                  layout%parameters(i)%text_values(k) = plan%parameters(i)%texts(plan%index_on(i, k))%value
               end do
            else
               allocate (layout%parameters(i)%values(plan%n_points))
               do k = 1, plan%n_points
                  layout%parameters(i)%values(k) = plan%parameters(i)%value(plan%index_on(i, k))
               end do
            end if
         end do
      end associate
   end subroutine describe_layout

   !> As `describe_layout`, without the values of swept parameters.
   subroutine describe_rows(self, n_ranks, layout, n_harmonics)
      type(study_t), intent(in) :: self
      integer, intent(in) :: n_ranks
      type(results_layout_t), intent(out) :: layout
      integer, intent(in), optional :: n_harmonics
      type(coordinates_t) :: coordinates
      integer, allocatable :: law_dofs(:)
      integer :: i

      associate (model => self%model, structure => self%model%system%structure, plan => self%plan)
         allocate (law_dofs, source=model%system%dofs_of_unknowns())
         layout%n_points = plan%n_points
         layout%tuples = self%tuples
         if (present(n_harmonics)) layout%tuples = self%tuples(:, :n_harmonics)
         call note_dofs(model%system, model%options, layout)
         layout%dof_units = [character(16) :: structure%units(model%options%output%dofs)]
         layout%law_dof_units = [character(16) :: structure%units(law_dofs)]
         layout%has_improved = has_improved(self)
         layout%has_accuracy = model%options%accuracy%is_on
         layout%has_own_tuples = model%options%accuracy%grows_set
         allocate (layout%output_names(size(model%options%accuracy%outputs)))
         do i = 1, size(layout%output_names)
            layout%output_names(i) = model%options%accuracy%outputs(i)%name
         end do
         layout%gradient_names = model%options%gradient%names
         layout%has_response_gradient = allocated(model%options%gradient%of)
         if (model%options%stability%method /= stability_method%off) layout%n_multipliers = n_multipliers_of(structure, &
            model%system%laws)
         layout%has_noise = any(is_random(model%system%loads))
         layout%has_noise_spectrum = model%options%stability%noise_frequency >= 0.0_wp
         layout%title = model%options%output%title
         layout%input_name = self%document%file_name
         layout%input_folder = trim(folder_of(self%document%file_name))
         layout%input_text = self%input_text
         layout%input_overrides = self%input_overrides
         layout%input_complete = self%input_complete
         layout%input_libraries = self%libraries()
         layout%n_ranks = n_ranks
         layout%program_version = program_version
         layout%git_commit = git_commit
         if (allocated(plan%curve)) then
            layout%curve_parameter = plan%curve%path
            layout%curve_units = plan%curve%units
            coordinates = coordinates_of(model%system)
            layout%n_curve_unknowns = 2*size(layout%tuples, 2)*coordinates%n + model%system%n_further()
            if (model%options%lacks_impacts_of(model%system, outcome%impact)) & ! a state and its scales, its phase, and the value
               layout%n_curve_unknowns = 2 + 2*(2*model%system%structure%n_dofs + &
                                             sum([(model%system%laws(i)%law%n_states, i=1, size(model%system%laws))]))
         end if
         allocate (layout%parameters(size(plan%parameters)))
         do i = 1, size(plan%parameters)
            layout%parameters(i)%path = plan%parameters(i)%path
            layout%parameters(i)%units = plan%parameters(i)%units
            layout%parameters(i)%is_text = plan%parameters(i)%is_text
         end do
      end associate
   end subroutine describe_rows

   !> Files besides the input on which the first point depends (hb_model_files).
   function study_libraries(self) result(text)
      class(study_t), intent(in) :: self
      character(:), allocatable :: text

      call self%model%system%list_files(text)
   end function study_libraries

   !> Size of one point in the result file, and the number of datasets to which it is written.
   subroutine row_of_study(self, n_bytes, n_datasets, n_harmonics)
      type(study_t), intent(in) :: self
      real(wp), intent(out) :: n_bytes
      integer, intent(out) :: n_datasets
      integer, intent(in), optional :: n_harmonics                    !! for harmonics; default: all
      type(results_layout_t) :: layout
      type(plan_t) :: plan

      call describe_rows(self, 1, layout, n_harmonics)
      call new_plan(plan, layout)
      call measure_row(plan, size(layout%parameters), n_bytes, n_datasets)
   end subroutine row_of_study
end module hb_study
