!> A model that is solved repeatedly in process with changing values: an input without files, its present model, and
!> the last motion, from which the next one may start.
!>
!> A call of `solve` corresponds to a point of a sweep in a run, and a curve is computed point by point; numbers are
!> the same to the last bit. Only one thread at a time may use a session.
module hb_session
   use hb_advice, only: advice, advice_list_t, append_advice, n_advice
   use hb_cancellation, only: verdict
   use hb_census, only: census_config_t, census_t, take_census
   use hb_claim, only: claim_t, new_claim
   use hb_clock, only: wall_clock
   use hb_curve_plan, only: curve_plan_t, read_curve_plan
   use hb_curve_request, only: usual_points
   use hb_curve_runner, only: curve_runner_t
   use hb_document, only: document_t, parameter_t
   use hb_error, only: error_t, fail
   use hb_fe_model, only: fe_model_source_t
   use hb_inactive_laws, only: inactive_laws_t
   use hb_integration, only: integrate_model, integration_t
   use hb_integration_verdict, only: kind_of_verdict => verdict, verdict_t
   use hb_kinds, only: wp
   use hb_law_findings, only: law_findings_t
   use hb_level, only: level_t
   use hb_model, only: model_t
   use hb_model_advice, only: advise_on_combination, advise_on_drive, advise_on_model
   use hb_model_reader, only: read_model, update_model
   use hb_model_tones, only: read_tones
   use hb_modes, only: find_natural_frequencies
   use hb_motion_advice, only: advise_on_motion
   use hb_motion_result, only: motion_result_t
   use hb_movement, only: follow_frequencies
   use hb_namelist, only: set_text
   use hb_neighbour, only: neighbour_t
   use hb_options, only: purpose_t
   use hb_outcome, only: is_solved, outcome, reason
   use hb_point_runner, only: run_model
   use hb_point_source, only: point_source_t
   use hb_property_values, only: content_t
   use hb_session_cancellation, only: session_cancellation_t
   use hb_session_input, only: session_input_t
   use hb_sweep_plan, only: read_sweep_plan
   use hb_sweep_runner, only: sweep_runner_t
   use hb_system, only: system_t
   use hb_text, only: to_text
   use hb_time_integration, only: add_time_integration
   use hb_tones, only: tones_t
   use hb_verification, only: verify_motion
   implicit none
   private
   public :: session_t

   !> Owner of external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type :: session_t
      type(session_input_t) :: input
      type(point_source_t) :: source                                  !! its model; its document and plan are those of a sweep
      type(motion_result_t) :: result                                 !! of the last `solve`, or the last point of a curve or sweep
      logical :: has_curve = .false.                                  !! `curve_next` may return a further point
      type(integration_t), allocatable :: record                      !! of the last `integrate`, if `verify` was not called since
      type(verdict_t) :: verdict                                      !! of the last `verify`
      real(wp) :: verification_time = huge(1.0_wp)                    !! processor time of a verification [s]: then undecided
      type(census_t), allocatable :: census                           !! of the present values
      type(session_cancellation_t) :: cancellation
      integer :: structure_number = 0                                 !! counts the structures that were read
      integer :: n_points = 1                                         !! points that share the time for stability which a run of
                                                                      !! the command has in addition to its points; 0: none
      type(sweep_runner_t) :: sweep
      logical, private :: has_law_findings = .false.                  ! `source%law_findings` is of the last motion
      type(neighbour_t), private :: neighbour
      type(curve_plan_t) :: plan                                      !! of the curve
      type(content_t), allocatable, private :: before                 ! of the group whose value the curve moves
      type(curve_runner_t), private :: runner                         ! of the curve
      logical, private :: has_verdict = .false.
      logical, private :: is_present = .false.                        ! the motion was computed with the present values
      integer, private :: n_sharing = -1                              ! `n_points` for which the callbacks were set,
      logical, private :: shares_of_curve = .false.                   ! or a curve
   contains
      procedure :: set_structure_source => session_set_structure_source
      procedure :: read => session_read
      procedure :: clear => session_clear
      procedure :: add_group => session_add_group
      procedure :: remove_group => session_remove_group
      procedure :: locate => session_locate
      procedure :: set => session_set
      procedure :: check_group => session_check_group
      procedure :: update => session_update
      procedure :: check_model => session_check_model
      procedure :: complete_input => session_complete_input
      procedure :: libraries => session_libraries
      procedure :: advise_on_model => session_advise_on_model
      procedure :: natural_frequencies => session_natural_frequencies
      procedure :: advise_on_motion => session_advise_on_motion
      procedure :: advise_on_laws => session_advise_on_laws
      procedure :: solve => session_solve
      procedure :: curve_begin => session_curve_begin
      procedure :: curve_lengthen => session_curve_lengthen
      procedure :: curve_next => session_curve_next
      procedure :: sweep_begin => session_sweep_begin
      procedure :: sweep_next => session_sweep_next
      procedure :: take_census => session_take_census
      procedure :: select_motion => session_select_motion
      procedure :: integrate => session_integrate
      procedure :: verify => session_verify
      procedure :: verify_motion => session_verify_motion
      procedure :: has_begun_curve => session_has_begun_curve
      procedure :: is_cut => session_is_cut
      procedure :: has_time_results => session_has_time_results
      procedure :: may_verify => session_may_verify
      procedure :: destroy => session_destroy
   end type session_t

contains

   !> Sets the source of structures for this and later inputs.
   subroutine session_set_structure_source(self, source)
      class(session_t), intent(inout) :: self
      class(fe_model_source_t), intent(in) :: source

      if (allocated(self%source%callbacks%fe_models)) deallocate (self%source%callbacks%fe_models)
      allocate (self%source%callbacks%fe_models, source=source)
      self%source%model%options%callbacks%fe_models = self%source%callbacks%fe_models
   end subroutine session_set_structure_source

   !> Reads a model from the text of an input, which replaces the previous one. Fails with all errors of the input.
   subroutine session_read(self, name, text, error)
      class(session_t), intent(inout), target :: self
      character(*), intent(in) :: name                                !! for messages
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error

      call forget_model(self)
      call self%input%read(name, text, error)
      if (.not. allocated(error)) call self%update(error)
      if (allocated(error)) call self%input%clear("")
   end subroutine session_read

   !> Removes all groups and the motions of the model.
   subroutine session_clear(self, folder)
      class(session_t), intent(inout) :: self
      character(*), intent(in) :: folder                              !! of the files that groups name, "models/"; or empty

      call forget_model(self)
      call self%input%clear(folder)
   end subroutine session_clear

   !> Adds a group without values, such as "law".
   subroutine session_add_group(self, name, handle, error)
      class(session_t), intent(inout), target :: self
      character(*), intent(in) :: name
      integer, intent(out) :: handle                                  !! identifies the group until it is removed
      type(error_t), allocatable, intent(out) :: error

      call self%input%add_group(name, handle, error)
      if (.not. allocated(error)) call note_change(self)
   end subroutine session_add_group

   !> Removes a group.
   subroutine session_remove_group(self, handle, error)
      class(session_t), intent(inout), target :: self
      integer, intent(in) :: handle
      type(error_t), allocatable, intent(out) :: error

      call self%input%check_handle(handle, error)
      if (allocated(error)) return
      call note_change(self)
      call self%input%remove_group(handle, error)
   end subroutine session_remove_group

   !> Finds the group of a value by its path, `law(stop)%gap`.
   subroutine session_locate(self, path, group, error)
      class(session_t), intent(inout), target :: self
      character(*), intent(in) :: path
      integer, intent(out) :: group                                   !! its handle
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: ignored

      group = 0
      call self%input%check(error)
      if (.not. (allocated(error) .or. self%source%model%is_read)) call self%update(ignored)   ! for its ties and keys
      if (.not. allocated(error)) call self%input%locate(path, group, error)
   end subroutine session_locate

   !> Sets a key of a group, "gap" or "frequency(2)", in the units of an input; no values: its default. Matrices are given by rows.
   !> The next computation reports what is invalid.
   subroutine session_set(self, group, key, values, error)
      class(session_t), intent(inout), target :: self
      integer, intent(in) :: group                                    !! its handle
      character(*), intent(in) :: key
      class(*), intent(in) :: values(:)                               !! reals, integers, logicals or string_t
      type(error_t), allocatable, intent(out) :: error
      type(parameter_t) :: parameter

      call self%input%find(group, key, size(values), parameter, error)
      if (allocated(error)) return
      call note_change(self)
      call self%input%set(parameter, values)
   end subroutine session_set

   !> Fails with what is wrong with a group by itself: the structure or the tones, or what is added to these.
   subroutine session_check_group(self, group, error)
      class(session_t), intent(inout), target :: self
      integer, intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      call self%input%check_group(group, self%source%callbacks, error)
   end subroutine session_check_group

   !> Forgets the model of the previous input, and its motions.
   subroutine forget_model(self)
      class(session_t), intent(inout) :: self

      call self%destroy()
      self%source%model%is_read = .false.
      self%result = motion_result_t()
      self%source%law_findings = law_findings_t()
      self%has_law_findings = .false.
      self%source%inactive_laws = inactive_laws_t()
      call self%neighbour%forget()
      call forget_integration(self)
      self%structure_number = self%structure_number + 1
   end subroutine forget_model

   !> Updates the model to the present values. Fails with all errors of the input.
   subroutine session_update(self, error, has_balance)
      class(session_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: has_balance                    !! fails if the model can only be integrated in time
      logical :: is_new

      call end_sweep(self)
      call self%input%check(error)
      if (allocated(error)) return
      call share_time(self, merge(self%n_points, self%n_sharing, self%n_sharing < 0))
      call update_model(self%source%model, self%input%document, is_new, error, callbacks=self%source%callbacks, &
                        purpose=self%source%purpose)
      if (is_new) self%structure_number = self%structure_number + 1
      if (present(has_balance) .and. .not. allocated(error)) call self%source%model%system%check_balance(error)
   end subroutine session_update

   !> The input with all permitted keys and their present values; invalid values are replaced by the previous ones.
   subroutine session_complete_input(self, text, only_given)
      class(session_t), intent(inout), target :: self
      character(:), allocatable, intent(out) :: text
      logical, intent(in), optional :: only_given                     !! without defaults, default false
      type(error_t), allocatable :: ignored

      text = ""
      if (.not. self%input%has_groups()) return
      if (self%sweep%is_begun .and. .not. present(only_given)) then
         text = self%sweep%input
         return
      end if
      call self%update(ignored)
      call self%input%complete(text, only_given)
   end subroutine session_complete_input

   !> Files besides the input on which the model depends, with their checksums (hb_model_files).
   subroutine session_libraries(self, text)
      class(session_t), intent(in) :: self
      character(:), allocatable, intent(out) :: text

      text = ""
      if (self%source%model%is_read) call self%source%model%system%list_files(text)
   end subroutine session_libraries

   !> Advises on the model with its present values (hb_model_advice).
   subroutine session_advise_on_model(self, list, error)
      class(session_t), intent(inout), target :: self
      type(advice_list_t), intent(out) :: list
      type(error_t), allocatable, intent(out) :: error

      call self%update(error)
      if (allocated(error)) return
      associate (model => self%source%model)
         call advise_on_model(model%system, model%discretisation, model%options, list)
         call advise_on_drive(model%system, model%discretisation, model%options, list)
      end associate
   end subroutine session_advise_on_model

   !> Natural frequencies [rad/s] of the structure with its present values (hb_modes).
   subroutine session_natural_frequencies(self, frequencies, error)
      class(session_t), intent(inout), target :: self
      real(wp), allocatable, intent(out) :: frequencies(:)
      type(error_t), allocatable, intent(out) :: error
      logical :: lacks_gyroscopic

      allocate (frequencies(0))
      call self%update(error)
      if (.not. allocated(error)) &
         call find_natural_frequencies(self%source%model%system%structure, frequencies, lacks_gyroscopic)
   end subroutine session_natural_frequencies

   !> Advises on the last motion (hb_motion_advice), and on laws whose derivatives are wrong along it.
   subroutine session_advise_on_motion(self, list)
      class(session_t), intent(inout), target :: self
      type(advice_list_t), intent(out) :: list
      type(system_t), pointer :: system
      integer :: n

      if (.not. self%source%model%is_read) return
      call advise_on_motion(self%source%model%options, self%result, list)
      if (self%result%is_near_commensurate) then
         system => system_of_result(self)
         n = n_advice(list)
         call advise_on_combination(system%tones, self%source%model%options%error_estimate%commensurability, list)
         if (n_advice(list) == n) call list%add(advice%vanishing_combination)
      end if
      if (self%has_law_findings) call append_advice(list, self%source%law_findings%found)
   end subroutine session_advise_on_motion

   !> Names the laws that exert no force on the last motion, or on all motions of the sweep so far.
   subroutine session_advise_on_laws(self, list)
      class(session_t), intent(inout), target :: self
      type(advice_list_t), intent(out) :: list
      type(inactive_laws_t) :: inactive

      if (.not. self%source%model%is_read) return
      if (self%sweep%is_begun) then
         inactive = self%source%inactive_laws
      else
         call inactive%examine(system_of_result(self), self%source%model%discretisation, self%result)
      end if
      call inactive%advise(self%source%model%system, list)
   end subroutine session_advise_on_laws

   !> Solves the model with its present values, from the last motion if requested and available. The status of the
   !> result reports a failure to converge; an error is one of the model.
   subroutine session_solve(self, is_warm, error)
      class(session_t), intent(inout), target :: self
      logical, intent(in) :: is_warm
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: failure
      type(level_t) :: level
      real(wp) :: started
      real(wp), parameter :: undistinguished_value = 0.0_wp           ! neighbours are not distinguished by a value

      started = wall_clock()
      call end_curve(self)
      call self%input%check(error)
      if (allocated(error)) return
      call share_time(self, self%n_points)
      call self%update(error, has_balance=.true.)
      if (allocated(error)) return
      if (.not. is_warm) call self%neighbour%forget()
      self%source%model%options%chain%is_on = is_warm
      call self%cancellation%begin_work()
      call self%cancellation%enter(self%source%model%options%solver%time_limit)
      call run_model(self%source%model, undistinguished_value, self%neighbour, self%source%cached, self%result, level, failure)
      call self%cancellation%leave()
      call self%neighbour%forget()                                    ! the last motion alone is a neighbour
      if (.not. allocated(failure) .and. allocated(level%unknowns)) &
         call self%neighbour%store(undistinguished_value, level, self%result%n_levels)
      if (self%cancellation%verdict == verdict%interrupted) self%result%status = outcome%interrupted
      self%result%solve_seconds = wall_clock() - started
      call complete_result(self)
   end subroutine session_solve

   !> Begins the curve of the group `&curve`; `curve_next` returns its points. Setting a value or another computation ends it, and
   !> restores the value that it moves.
   subroutine session_curve_begin(self, error)
      class(session_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      type(tones_t) :: tones

      call end_curve(self)
      call self%input%check(error)
      if (allocated(error)) return
      call read_curve_plan(self%plan, self%input%document, error)
      if (.not. allocated(error)) call read_tones(tones, self%input%document, error)
      if (.not. allocated(error)) call self%plan%tie_tones(self%input%document, tones%omega, error)
      if (.not. allocated(error) .and. len(self%plan%origin_path) > 0) &
         call fail(error, "&curve: origin: result files are not read here")
      if (allocated(error)) return
      call self%input%document%reject_tied(self%plan%parameter, self%plan%path, error)
      if (allocated(error)) return
      self%before = self%input%document%groups%holders(self%plan%parameter%i_group)%group%content
      call self%plan%set(self%input%document, self%plan%start)
      call share_time(self, min(self%plan%n_points, usual_points))
      call self%update(error, has_balance=.true.)
      if (.not. allocated(error)) call self%plan%make_request(self%source%model, self%input%document, self%runner%request, error)
      if (allocated(error)) return
      self%result = motion_result_t()
      self%runner%model = self%source%model
      call self%runner%prepare()
      self%has_curve = .true.
   end subroutine session_curve_begin

   !> Gives a curve that has ended at its number of points more of them, in its input too.
   subroutine session_curve_lengthen(self, n_points, error)
      class(session_t), intent(inout), target :: self
      integer, intent(in) :: n_points                                 !! of the whole curve
      type(error_t), allocatable, intent(out) :: error
      type(curve_plan_t), allocatable :: longer
      type(document_t) :: document

      if (n_points <= self%plan%n_points) then
         call fail(error, "the curve has "//to_text(self%plan%n_points)//" points; give more, not "//to_text(n_points))
         return
      end if
      allocate (longer)
      document = self%input%document
      call set_text(document, "curve%points", to_text(n_points), error)
      if (.not. allocated(error)) call read_curve_plan(longer, document, error)   ! refuses too many
      if (allocated(error)) return
      call set_text(self%input%document, "curve%points", to_text(n_points), error)
      self%plan%n_points = n_points
      call self%runner%lengthen(n_points)
      self%has_curve = .not. self%runner%is_done
   end subroutine session_curve_lengthen

   !> Whether the curve has ended because it has no room for more points.
   logical function session_is_cut(self) result(is_cut)
      class(session_t), intent(in) :: self

      is_cut = self%runner%is_prepared() .and. .not. self%has_curve .and. self%result%reason == reason%points
   end function session_is_cut

   !> Makes the next point of the curve the result; `has_curve` is false if it was the last. What fails at a point becomes its
   !> status and ends the curve; an error is a call after its end.
   subroutine session_curve_next(self, error)
      class(session_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: failure

      if (.not. self%has_curve) then
         call fail(error, "the curve has no further point")
         return
      end if
      call self%cancellation%begin_work()
      call self%runner%next(self%cancellation, self%result, failure)
      self%has_curve = .not. (self%runner%is_done .or. self%result%status == outcome%interrupted)
      call complete_result(self)
   end subroutine session_curve_next

   !> Begins the sweep of the groups `&sweep`; `sweep_next` returns its points. Setting a value or another computation ends it.
   subroutine session_sweep_begin(self, error)
      class(session_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error

      call end_curve(self)
      call self%input%check(error)
      if (allocated(error)) return
      call self%update(error)
      if (allocated(error)) return
      self%source%document = self%input%document
      call read_sweep_plan(self%source%plan, self%source%document, error)
      if (allocated(error)) return
      call share_time(self, merge(self%source%plan%n_points, 0, self%n_points > 0))
      self%source%inactive_laws = inactive_laws_t()
      call self%neighbour%forget()
      call self%sweep%begin(self%source, error)
      if (allocated(error)) self%source%model%is_read = .false.
      self%result = motion_result_t()
   end subroutine session_sweep_begin

   !> Makes the next point of the sweep the result. What fails at a point becomes its status; an error is a call after the end.
   subroutine session_sweep_next(self, error)
      class(session_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      logical :: was_examined

      if (.not. self%sweep%has_next()) then
         call fail(error, "the sweep has no further point")
         return
      end if
      was_examined = self%source%law_findings%is_done
      call self%cancellation%begin_work()
      call self%cancellation%enter(huge(1.0_wp))
      call self%sweep%next(self%source, self%result)
      call self%cancellation%leave()
      call complete_result(self)
      self%has_law_findings = self%source%law_findings%is_done .and. .not. was_examined
      self%is_present = .false.                                       ! the values are those of the point
   end subroutine session_sweep_next

   !> Searches for all motions of the model with its present values.
   subroutine session_take_census(self, config, error)
      class(session_t), intent(inout), target :: self
      type(census_config_t), intent(in) :: config
      type(error_t), allocatable, intent(out) :: error

      call end_curve(self)
      if (allocated(self%census)) deallocate (self%census)
      call share_time(self, self%n_points)
      call self%update(error, has_balance=.true.)
      if (allocated(error)) return
      allocate (self%census)
      call self%cancellation%begin_work()
      call self%cancellation%enter(huge(1.0_wp))
      call take_census(self%source%model, config, self%census, error)
      call self%cancellation%leave()
      call self%neighbour%forget()
      if (allocated(error)) deallocate (self%census)
   end subroutine session_take_census

   !> Makes a motion of the census the last one.
   subroutine session_select_motion(self, i)
      class(session_t), intent(inout) :: self
      integer, intent(in) :: i                                        !! from 1

      self%result = self%census%motions(i)%result
      call complete_result(self)
   end subroutine session_select_motion

   !> Integrates the model in time with its present values, as defined by `&integration`. An interrupted integration
   !> leaves no record.
   subroutine session_integrate(self, error)
      class(session_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error

      call end_curve(self)
      call forget_integration(self)
      call self%update(error)
      if (.not. allocated(error) .and. len(self%source%model%options%integration%record) > 0) &
         call fail(error, "&integration: continue: result files are not read here")
      if (allocated(error)) return
      allocate (self%record)
      call self%cancellation%begin_work()
      call self%cancellation%enter(huge(1.0_wp))
      associate (model => self%source%model)
         call integrate_model(self%record, model%system, model%discretisation, model%options, error)
      end associate
      call self%cancellation%leave()
      if (allocated(error)) deallocate (self%record)
      if (self%cancellation%verdict == verdict%interrupted .and. allocated(error)) deallocate (error)
   end subroutine session_integrate

   !> Integrates from the last motion of `solve`, and from a neighbouring state, until the verdict is clear.
   subroutine session_verify(self, n_periods, error)
      class(session_t), intent(inout), target :: self
      integer, intent(in) :: n_periods                                !! of the slowest tone, at most; 0: from the decay rate
      type(error_t), allocatable, intent(out) :: error

      call self%input%check(error)
      if (allocated(error)) return
      call forget_integration(self)
      if (allocated(self%result%curve) .or. .not. is_solved(self%result%status)) then
         call fail(error, "there is no motion of `solve` that can be verified")
      else if (.not. self%is_present) then
         call fail(error, "values have changed since the motion was computed; solve again before the verification")
      else
         call self%verify_motion(self%result, n_periods, error)
      end if
   end subroutine session_verify

   !> Integrates from a motion of the model with its present values, and from a neighbouring state, until the verdict is clear.
   subroutine session_verify_motion(self, motion, n_periods, error)
      class(session_t), intent(inout), target :: self
      type(motion_result_t), intent(in) :: motion                     !! at all degrees of freedom
      integer, intent(in) :: n_periods                                !! as for `verify`
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(model_t) :: model
      type(claim_t) :: claim

      call self%input%check(error)
      if (allocated(error)) return
      if (n_periods < 0) then
         call fail(error, "the number of periods must be positive, or 0 for as many as the decay requires, not "// &
                   to_text(n_periods))
         return
      end if
      call end_curve(self)
      call forget_integration(self)
      document = self%input%document
      call read_model(model, document, error, callbacks=self%source%callbacks, purpose=self%source%purpose)
      if (.not. allocated(error)) call model%system%check_balance(error)
      if (allocated(error)) return
      if (size(motion%coefficients, 3) /= model%system%structure%n_dofs) then
         call fail(error, "time integration starts from all degrees of freedom; solve without &output dofs")
         return
      else if (size(motion%frequency) /= model%system%tones%n_tones) then
         call fail(error, "the motion has "//to_text(size(motion%frequency))//" tones, the model "// &
                   to_text(model%system%tones%n_tones))
         return
      end if
      if (any(model%system%tones%is_unknown)) then                    ! values may follow unknown frequencies
         call follow_frequencies(model, motion%frequency, error)
         if (allocated(error)) return
      end if
      call new_claim(claim, motion, model%discretisation%harmonics%tuples, model%options%accuracy%grows_set)
      call self%cancellation%begin_work()
      call self%cancellation%enter(self%verification_time)
      call verify_motion(model, claim, n_periods, self%verdict, error)
      call self%cancellation%leave()
      if (any(self%cancellation%verdict == [verdict%interrupted, verdict%timed_out]) .and. allocated(error)) deallocate (error)
      if (self%cancellation%verdict == verdict%timed_out) &
         self%verdict = verdict_t(kind=kind_of_verdict%undecided, coordinate="", drift=0.0_wp*motion%frequency)
      self%has_verdict = .not. allocated(error)
   end subroutine session_verify_motion

   !> Whether `verify` may be called: a motion of `solve` was found, and no value has changed since.
   logical function session_may_verify(self) result(may_verify)
      class(session_t), intent(in) :: self

      may_verify = self%is_present .and. is_solved(self%result%status) .and. .not. allocated(self%result%curve)
   end function session_may_verify

   !> Whether there is a curve, which may have no further point.
   logical function session_has_begun_curve(self) result(has_begun)
      class(session_t), intent(in) :: self

      has_begun = self%runner%is_prepared()
   end function session_has_begun_curve

   !> Whether there are results of `integrate` or `verify`.
   logical function session_has_time_results(self) result(has)
      class(session_t), intent(in) :: self

      has = allocated(self%record) .or. self%has_verdict
   end function session_has_time_results

   !> Sets the number of points that share the time of a run for stability; the model is read again if it changes.
   subroutine share_time(self, n_points)
      class(session_t), intent(inout) :: self
      integer, intent(in) :: n_points

      self%source%purpose = purpose_t(is_followed=self%input%document%is_given("curve"), may_only_integrate=.true.)
      if (n_points == self%n_sharing .and. (self%source%purpose%is_followed .eqv. self%shares_of_curve)) return
      call add_time_integration(self%source%callbacks, self%source%purpose%is_followed, n_points)
      self%source%model%is_read = .false.
      self%n_sharing = n_points
      self%shares_of_curve = self%source%purpose%is_followed
   end subroutine share_time

   !> Fails if there is no input, or if its present values are invalid.
   subroutine session_check_model(self, error)
      class(session_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error

      call self%input%check(error)
      if (.not. (allocated(error) .or. self%source%model%is_read)) &
         call fail(error, "the present values of the input are invalid; set others and compute again")
   end subroutine session_check_model

   !> Notes that a value of the input changes: a curve ends, and the last motion is not one of the present values.
   subroutine note_change(self)
      class(session_t), intent(inout), target :: self
      type(error_t), allocatable :: ignored
      logical :: had_sweep

      had_sweep = self%sweep%is_begun
      call end_curve(self)
      if (had_sweep) call self%update(ignored)                        ! columns of its last point can be read still
      if (allocated(self%census)) deallocate (self%census)
      self%is_present = .false.
   end subroutine note_change

   !> Gives a result the harmonics of the model if it has none of its own, since the model may change.
   subroutine complete_result(self)
      class(session_t), intent(inout), target :: self

      if (.not. allocated(self%result%harmonics%tuples)) self%result%harmonics = self%source%model%discretisation%harmonics
      self%is_present = .true.
      self%has_law_findings = .not. self%source%law_findings%is_done
      call self%source%law_findings%examine(system_of_result(self), self%source%model%discretisation, self%result)
      self%has_law_findings = self%has_law_findings .and. self%source%law_findings%is_done
   end subroutine complete_result

   !> The system of the last motion: at a point of a curve with the numbers that it has there.
   function system_of_result(self) result(system)
      class(session_t), intent(inout), target :: self
      type(system_t), pointer :: system

      system => self%source%model%system
      if (self%runner%is_prepared()) system => self%runner%system_at(self%result)
   end function system_of_result

   subroutine forget_integration(self)
      class(session_t), intent(inout) :: self

      if (allocated(self%record)) deallocate (self%record)
      self%verdict = verdict_t()
      self%has_verdict = .false.
   end subroutine forget_integration

   subroutine end_curve(self)
      class(session_t), intent(inout) :: self

      call self%runner%destroy()
      self%has_curve = .false.
      if (allocated(self%before)) then
         associate (group => self%input%document%groups%holders(self%plan%parameter%i_group)%group)
            group%content = self%before
            group%has_changed = .true.
         end associate
         deallocate (self%before)
      end if
      call end_sweep(self)
   end subroutine end_curve

   !> Ends a sweep: the model gets the present values again.
   subroutine end_sweep(self)
      class(session_t), intent(inout) :: self

      if (.not. self%sweep%is_begun) return
      self%sweep = sweep_runner_t()
      self%source%model%is_read = .false.
   end subroutine end_sweep

   !> Frees all; safe to call twice.
   subroutine session_destroy(self)
      class(session_t), intent(inout) :: self

      call end_curve(self)
      call self%source%cached%destroy()
   end subroutine session_destroy

end module hb_session
