!> The group `&curve`: the moving value, its range, and the points that are located.
module hb_curve_plan
   use hb_amplitudes, only: amplitudes_t
   use hb_curve_request, only: curve_request_t
   use hb_discretisation, only: discretisation_t
   use hb_document, only: document_t, parameter_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_law, only: hold_t
   use hb_located_response, only: located_response_t
   use hb_model, only: model_t
   use hb_model_number, only: moving_groups, moving_value_t, numbered_groups
   use hb_movement, only: movement_t, new_movement
   use hb_number_paths, only: not_in_set
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_parameter_number, only: find_number, followed_groups, list_groups
   use hb_point_kinds, only: curve_kind_names, curve_kinds, located_by, response_keys, response_kinds, target_keys
   use hb_properties, only: properties_t
   use hb_property_record, only: line_of_curve
   use hb_response, only: new_response
   use hb_stability, only: stability_method
   use hb_system, only: system_t
   use hb_text, only: lower, shown, string_t, to_text
   use hb_thresholds, only: rounding_level
   implicit none
   private
   public :: curve_plan_t, read_curve_plan

   character(*), parameter :: not_real = "is not a real number; only real numbers can vary continuously"

   !> Names of responses, and the values at which each of them is located, where its kind has these.
   type :: names_t
      type(string_t), allocatable :: names(:)
      real(wp), allocatable :: targets(:)
   end type names_t

   !> A request whose responses and origin are still text: resolving them requires the model.
   type, extends(curve_request_t) :: curve_plan_t
      character(:), allocatable :: path                               !! in the input, such as tones%frequency
      type(parameter_t) :: parameter                                  !! that it is
      character(:), allocatable :: units                              !! of the value; empty until known
      character(:), allocatable :: location                           !! of the group, for messages
      type(names_t) :: responses_of(size(response_keys))          !! as the keys
      character(:), allocatable :: origin_path !! result file whose point is the origin of the curve; empty: none
      integer :: origin_point = 0                                     !! from 0
      integer, allocatable :: torus_order(:)                          !! of the set of a torus that leaves the curve; none: chosen
      character(:), allocatable :: over_path !! path of the value `over` which the located point is followed
      type(parameter_t) :: over_parameter                             !! that it is
      real(wp), allocatable :: ratios(:)                              !! of all tones to the moving one, if they are tied
      logical :: has_given_points = .false.                           !! otherwise a curve gets more of them until it ends
   contains
      procedure :: set => curve_plan_set
      procedure :: tie_tones => curve_plan_tie_tones
      procedure :: describe => curve_plan_describe
      procedure :: make_request => curve_plan_make_request
   end type curve_plan_t

contains

   !> Reads `&curve` and resolves its path in the document; fails with all problems of the group.
   subroutine read_curve_plan(self, document, error)
      type(curve_plan_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      character(:), allocatable :: follow, tie
      integer :: i

      call document%required_group("curve", group, error)
      if (allocated(error)) return
      self%location = group%location()
      self%units = ""
      allocate (self%values(0), self%others(0))
      call group%get("parameter", self%path)
      call group%get("from", self%from)
      call group%get("to", self%to)
      self%start = self%from
      call group%get("start", self%start)
      call group%get("values", self%values)
      call group%get("others", self%others)
      call group%get("points", self%n_points)
      self%has_given_points = group%given("points")
      call group%get("max_step", self%longest_step)
      do i = 1, size(response_keys)
         associate (responses => self%responses_of(i))
            allocate (responses%names(0), responses%targets(0))
            call group%get(trim(response_keys(i)), responses%names)
            if (target_keys(i) == "") cycle
            call group%get(trim(target_keys(i)), responses%targets)
            if (size(responses%targets) > 0 .and. size(responses%names) == 0) &
               call group%problem(trim(target_keys(i)), "require '"//trim(response_keys(i))//"' with their responses")
            if (size(responses%targets) == 0 .and. size(responses%names) > 0) &
               call group%problem(trim(response_keys(i)), "requires '"//trim(target_keys(i))//"', at which it is located")
         end associate
      end do
      call group%get("tie", tie)
      self%moving%is_tied = tie == "ratio"
      call group%get("switch", self%switches)
      call group%get("jump", self%jumps)
      call group%get("follow", follow)
      if (follow /= "motion") call read_over(self, group, follow)
      self%origin_path = ""
      call group%get("origin", self%origin_path)
      if (self%jumps) call check_jumps(self, group)
      if (len(self%origin_path) > 0) call group%get("origin_point", self%origin_point)
      allocate (self%torus_order(0))
      call group%get("torus_order", self%torus_order, n=2)
      if (group%given("from") .and. group%given("to")) call check_range(self, group)
      call group%finish(error)
      if (allocated(error)) return
      call find_values(self, document, error)
      group => document%group("curve", 1)
      self%parameter%line = line_of_curve(group%line)
   end subroutine read_curve_plan

   !> Reports a problem for each of the values that is outside the range.
   subroutine check_range(self, group)
      type(curve_plan_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group

      self%moving%typical = abs(self%to - self%from)
      if (.not. self%moving%typical > 0.0_wp) call group%problem("to", "is the same as 'from': the range is empty")
      if ((self%start - self%from)*(self%start - self%to) > 0.0_wp) &
         call group%problem("start", "must lie between 'from' and 'to'")
      call check_values("values", self%values)
      call check_values("others", self%others)

   contains

      subroutine check_values(key, values)
         character(*), intent(in) :: key
         real(wp), intent(in) :: values(:)
         integer :: k

         do k = 1, size(values)
            if ((values(k) - self%from)*(values(k) - self%to) <= 0.0_wp) cycle
            call group%problem(key, "must lie between 'from' and 'to'; "//to_text(values(k))//" does not")
            return
         end do
      end subroutine check_values
   end subroutine check_range

   !> Reports a problem for each key that has no meaning with jumps.
   subroutine check_jumps(self, group)
      type(curve_plan_t), intent(in) :: self
      type(properties_t), intent(inout) :: group

      if (allocated(self%over)) call group%problem("jump", "is for the motion itself, not for a located point")
      if (self%switches) call group%problem("jump", "leaves the curve at its folds; 'switch' follows the curves that cross it: "// &
                                            "give one of them")
      if (size(self%others) > 0) call group%problem("jump", "leaves the curve at its folds; 'others' follows curves to their "// &
                                                    "ends: give one of them")
      if (len(self%origin_path) > 0) call group%problem("jump", "is for a curve from an end of its range, not from an 'origin'")
      if ((self%start - self%from)*(self%start - self%to) < 0.0_wp) &
         call group%problem("start", "must be 'from' or 'to' with 'jump', which goes to the other end")
   end subroutine check_jumps

   !> Reads the value over which a located point is followed.
   subroutine read_over(self, group, follow)
      type(curve_plan_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: follow                              !! one of `curve_kind_names`
      integer :: i, n
      logical :: has_targets

      allocate (self%over)
      self%over%kind = findloc(curve_kind_names, follow, dim=1) - 1
      call group%get("over", self%over_path)
      call group%get("over_from", self%over%from)
      call group%get("over_to", self%over%to)
      self%over%moving%typical = abs(self%over%to - self%over%from)
      do i = 1, size(response_keys)
         if (response_kinds(i) /= self%over%kind) cycle
         has_targets = target_keys(i) /= ""
         n = size(self%responses_of(i)%names)
         if (has_targets) n = n*size(self%responses_of(i)%targets)
         if (n /= 1) call group%problem(trim(response_keys(i)), "name the one response whose "//follow//" is followed"// &
                                        repeat(", and its one "//follow, merge(1, 0, has_targets)))
      end do
      if (abs(self%start - self%from) > 0.0_wp) call group%problem("start", "a "//follow//" is followed from 'from'")
      if (size(self%others) > 0) call group%problem("others", "is for the motion itself, not for a "//follow)
      if (self%switches) call group%problem("switch", "is for the motion itself, not for a "//follow)
      if (group%given("over") .and. group%given("parameter")) then
         if (self%over_path == self%path) call group%problem("over", "moves along 'parameter' already; name another value")
      end if
      if (group%given("over_from") .and. group%given("over_to")) then
         if (.not. self%over%moving%typical > 0.0_wp) &
            call group%problem("over_to", "is the same as 'over_from': the range is empty")
      end if
   end subroutine read_over

   !> Resolves the paths; fails if one is not a single number that can move.
   subroutine find_values(self, document, error)
      type(curve_plan_t), intent(inout) :: self
      type(document_t), intent(inout) :: document
      type(error_t), allocatable, intent(out) :: error

      call document%resolve(self%path, self%parameter, error)
      if (allocated(error)) then
         error%message = self%location//": parameter '"//shown(self%path)//"': "//error%message
         return
      end if
      if (allocated(self%over)) then
         call document%resolve(self%over_path, self%over_parameter, error)
         if (.not. allocated(error)) then
            if (.not. any(moving_groups == document%groups%holders(self%over_parameter%i_group)%group%name)) then
               call fail(error, "a curve follows a number of "//trim(list_groups(numbered_groups%may_move, "or")))
            else if (document%n_tones_of(self%over_parameter) > 1) then
               call fail(error, "specify the tone that moves, such as '"//trim(lower(self%over_path))//"(1)'")
            end if
         end if
         if (allocated(error)) then
            error%message = self%location//": over '"//shown(self%over_path)//"': "//error%message
            return
         end if
      end if
      associate (name => document%groups%holders(self%parameter%i_group)%group%name)
         if (.not. any(followed_groups == name)) &
            call fail(error, self%location//": parameter '"//shown(self%path)// &
                      "': a curve follows a number of "//trim(list_groups(numbered_groups%may_move, "or"))// &
                      ", or of &normal_mode; give others to &sweep")
         if (name /= "tones" .and. self%moving%is_tied) &
            call fail(error, self%location//": tie: 'ratio' is for the frequency of a tone")
      end associate
      if (document%n_tones_of(self%parameter) > 1) &
         call fail(error, self%location//": parameter '"//shown(self%path)//"': there are "// &
                   to_text(document%n_tones_of(self%parameter))//" tones; say which of them moves, such as '"// &
                   trim(lower(self%path))//"(1)', and tie = 'ratio' if the others move along")
   end subroutine find_values

   !> Creates the request of the continuation, for the model at the start; hb_stored_origin adds an origin in a file.
   !> Fails if the path is not a real number or not a single one, or if a response is unknown.
   subroutine curve_plan_make_request(self, model, document, request, error)
      class(curve_plan_t), intent(in) :: self
      type(model_t), intent(inout) :: model                           !! unchanged
      type(document_t), intent(in) :: document                        !! from which it was read
      type(curve_request_t), intent(out) :: request
      type(error_t), allocatable, intent(out) :: error
      type(located_response_t) :: response
      integer :: i, k

      call check_model(self, model%system, model%options, document, error)
      if (allocated(error)) return
      request = self%curve_request_t
      call find_moving(self%parameter, "parameter '"//shown(self%path)//"'", request%moving)
      if (allocated(request%over) .and. .not. allocated(error)) &
         call find_moving(self%over_parameter, "over '"//shown(self%over_path)//"'", request%over%moving)
      if (allocated(error)) return
      if (size(request%others) == 0) deallocate (request%others)
      allocate (request%responses(0))
      do k = 1, size(response_keys)
         do i = 1, size(self%responses_of(k)%names)
            response = located_response_t(kind=response_kinds(k))
            call new_response(response%response_t, self%responses_of(k)%names(i)%value, model%system%structure, &
                              model%system%tones%n_tones, error)
            if (.not. (allocated(error) .or. model%options%accuracy%grows_set .or. &
                       response%is_in(model%discretisation%harmonics))) &
               call fail(error, "'"//response%name//"': "//not_in_set)
            if (curve_kinds(response%kind)%needs_load .and. .not. allocated(error)) &
               call check_loads(model%system, model%discretisation, response, error)
            if (allocated(error)) then
               error%message = self%location//": "//trim(response_keys(k))//": "//error%message
               return
            end if
            if (target_keys(k) == "") then
               request%responses = [request%responses, response]
            else
               call add_targets(self%responses_of(k)%targets, response, request%responses)
            end if
         end do
      end do

   contains

      !> The number of the model that moves; fails if it cannot, or if something follows it that cannot.
      subroutine find_moving(parameter, name, moving)
         type(parameter_t), intent(in) :: parameter
         character(*), intent(in) :: name                             !! for the message
         type(moving_value_t), intent(inout) :: moving
         type(movement_t) :: movement

         call find_number(document, parameter, moving%number)
         call new_movement(movement, model, moving%number, moving%is_tied, error)
         if (allocated(error)) error%message = self%location//": "//name//": "//error%message
      end subroutine find_moving
   end subroutine curve_plan_make_request

   !> Whether a wall has a given restitution.
   logical function has_restitution(system)
      type(system_t), intent(in) :: system
      type(hold_t) :: hold
      integer :: i

      has_restitution = .false.
      do i = 1, size(system%laws)
         if (system%laws(i)%law%is_multiplier) hold = system%laws(i)%law%hold()
         has_restitution = has_restitution .or. hold%restitution >= 0.0_wp
      end do
   end function has_restitution

   !> Why motions with impacts have no curve along these values; empty if they have one.
   subroutine find_refusal_with_impacts(self, system, options, text)
      class(curve_plan_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      character(:), allocatable, intent(out) :: text
      character(*), parameter :: which = "with walls that have a restitution, a curve "

      text = ""
      if (any(system%tones%is_unknown)) then
         text = which//"needs a given tone; replace the wall by an elastic_stop, or give the frequency"
      else if (system%tones%n_tones > 1) then
         text = which//"needs one tone, for motions of several tones have no period; integrate them one by one: "// &
                "&sweep parameter = '"//shown(self%path)//"', from = "//to_text(self%from)//", to = "//to_text(self%to)// &
                ", n = 20 /"
      else if (.not. options%lacks_impacts_of(system, outcome%impact)) then
         text = which//"needs a restitution of every wall: its own, or that of &integration"
      else if (allocated(self%over) .or. size(self%others) > 0) then
         text = which//"follows the motion from 'start' or 'origin', and with 'switch' those that cross it: 'follow' and "// &
                "'others' need a balance; leave them out, or replace the wall by an elastic_stop"
      end if
   end subroutine find_refusal_with_impacts

   !> Fails if the model has no curve along these values.
   subroutine check_model(self, system, options, document, error)
      class(curve_plan_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(document_t), intent(in) :: document
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: refusal

      call find_refusal_of_value(self, system, options, document, refusal)
      if (len(refusal) > 0) then
         call fail(error, self%location//": parameter '"//shown(self%path)//"': "//refusal)
         return
      end if
      if (self%jumps .and. any(system%tones%is_unknown)) then
         call fail(error, self%location//": jump: beyond a fold motions are sought where all tones are given")
         return
      end if
      if (size(self%others) > 0 .and. any(system%tones%is_unknown)) then
         call fail(error, self%location//": others: motions apart from a curve are sought where all tones are given")
         return
      end if
      if (.not. allocated(self%over)) return
      call find_refusal_of_over(self, system, options, document, refusal)
      if (len(refusal) > 0) call fail(error, self%location//": over '"//shown(self%over_path)//"': "//refusal)
   end subroutine check_model

   !> Why the value cannot move along a curve; empty if it can.
   subroutine find_refusal_of_value(self, system, options, document, text)
      class(curve_plan_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(document_t), intent(in) :: document
      character(:), allocatable, intent(out) :: text
      logical :: is_mode, is_tones

      text = ""
      associate (name => document%groups%holders(self%parameter%i_group)%group%name)
         is_tones = name == "tones"
         is_mode = name == "normal_mode"
      end associate
      if (.not. document%is_real(self%parameter)) then
         text = not_real
      else if (system%normal_mode%has_energy .and. .not. is_mode) then
         text = "a curve keeps the amplitude of a &normal_mode, not its energy"
      else if (is_mode .and. document%drives(self%parameter)) then
         text = "no &tie may follow what a curve moves in &normal_mode"
      else if (is_mode .and. min(self%from*self%start, self%to*self%start) <= 0.0_wp) then
         text = "an amplitude or energy must not be 0 and must not change its sign on a curve"
      else if (has_restitution(system)) then
         call find_refusal_with_impacts(self, system, options, text)
      end if
      if (.not. is_tones .or. len(text) > 0) return
      if (system%tones%is_unknown(max(1, self%parameter%element(1)))) text = "this frequency is unknown, not given"
      if (any(system%tones%is_unknown) .and. self%moving%is_tied) text = "tie = 'ratio' needs tones that are all given"
   end subroutine find_refusal_of_value

   !> Why the located points cannot be continued over the first value; empty if they can.
   subroutine find_refusal_of_over(self, system, options, document, text)
      class(curve_plan_t), intent(in) :: self                         !! with `over`
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(document_t), intent(in) :: document
      character(:), allocatable, intent(out) :: text
      logical :: has_multipliers

      text = ""
      has_multipliers = curve_kinds(self%over%kind)%by == located_by%multipliers
      if (any(system%tones%is_unknown)) then
         text = "tones must be given"
      else if (has_multipliers .and. system%tones%n_tones > 2) then
         text = "period doublings and Neimark-Sacker points are located on curves of motions with one or two tones"
      else if (has_multipliers .and. options%stability%method == stability_method%off) then
         text = "period doublings and Neimark-Sacker points are located by the multipliers that &stability finds"
      else if (has_multipliers .and. .not. options%may_integrate) then
         text = "period doublings and Neimark-Sacker points are located by multipliers, which are not known with a "// &
                "&dynamic_stiffness, a &sector, a delay of &feedback or frequencies of a &bearing"
      else if (.not. document%is_real(self%over_parameter)) then
         text = not_real
      end if
   end subroutine find_refusal_of_over

   !> Adds a response with each of some values.
   subroutine add_targets(targets, response, responses)
      real(wp), intent(in) :: targets(:)
      type(located_response_t), intent(in) :: response
      type(located_response_t), allocatable, intent(inout) :: responses(:)
      integer :: i

      do i = 1, size(targets)
         responses = [responses, response]
         responses(size(responses))%target = targets(i)
      end do
   end subroutine add_targets

   !> Fails if a response is not a harmonic with loads of one phase, with which it could be compared.
   subroutine check_loads(system, discretisation, response, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(located_response_t), intent(in) :: response
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: loads(system%structure%n_dofs), largest
      type(amplitudes_t) :: all_loads
      integer :: h

      h = 0
      if (allocated(response%tuple)) h = discretisation%harmonics%index_of(response%tuple)
      all_loads = system%loads_in(discretisation%harmonics)
      if (all(all_loads%harmonics /= h) .or. h == 0) then
         call fail(error, "'"//response%name//"': name a harmonic that has a &load")
      else if (all(response%tuple == 0)) then
         call fail(error, "'"//response%name//"': a mean value has no phase")
      else
         loads = all_loads%of(h)
         largest = loads(maxloc(abs(loads), dim=1))
         if (any(abs(aimag(loads*conjg(largest))) > rounding_level*abs(largest)**2)) &
            call fail(error, "'"//response%name//"': its loads have several phases")
      end if
   end subroutine check_loads

   !> Stores the ratios of tied tones of the input. Fails for a tone that does not exist.
   subroutine curve_plan_tie_tones(self, document, omega, error)
      class(curve_plan_t), intent(inout) :: self
      type(document_t), intent(in) :: document
      real(wp), intent(in) :: omega(:)                                !! base frequencies, (n_tones)
      type(error_t), allocatable, intent(out) :: error

      if (document%groups%holders(self%parameter%i_group)%group%name /= "tones") return
      if (self%parameter%element(1) > size(omega)) then
         call fail(error, self%location//": parameter '"//shown(self%path)//"': the highest number of a tone is "// &
            to_text(size(omega)))
      else if (self%moving%is_tied) then
         self%ratios = omega/omega(max(1, self%parameter%element(1)))
      end if
   end subroutine curve_plan_tie_tones

   !> Sets the moving value, and the tied ones.
   pure subroutine curve_plan_set(self, document, value)
      class(curve_plan_t), intent(in) :: self
      type(document_t), intent(inout) :: document
      real(wp), intent(in) :: value
      type(parameter_t) :: tone
      integer :: i

      call document%set(self%parameter, value)
      if (.not. allocated(self%ratios)) return
      tone = self%parameter
      do i = 1, size(self%ratios)
         tone%element(1) = i
         if (i /= self%parameter%element(1)) call document%set(tone, self%ratios(i)*value)
      end do
   end subroutine curve_plan_set

   !> Path and range with the unit, for messages.
   function curve_plan_describe(self) result(text)
      class(curve_plan_t), intent(in) :: self
      character(:), allocatable :: text

      text = self%path//": from "//to_text(self%from)//" to "//to_text(self%to)
      if (len(self%units) > 0 .and. self%units /= "1") text = text//" "//self%units
      text = text//", up to "//to_text(self%n_points)//" points"
   end function curve_plan_describe
end module hb_curve_plan
