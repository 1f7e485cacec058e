!> Advice of the command on a run that is possible: values of a sweep that are solved twice, speeds that stay constant while tones
!> move, models that are large or were reduced for lower frequencies. On the model itself: hb_model_advice.
module run_advice
   use hb_advice, only: advice, advice_list_t
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_balance, only: indifferent_coordinates
   use hb_contact_flexibility, only: pays_to_factorise
   use hb_contact_parts, only: is_factorised
   use hb_coordinates, only: coordinates_t
   use hb_document, only: document_t, parameter_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_element_catalogue, only: element_groups
   use hb_error, only: error_t
   use hb_kinds, only: two_pi, wp
   use hb_law_coordinates, only: laws_at
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_load_catalogue, only: load_groups
   use hb_model, only: model_t
   use hb_model_advice, only: advise_on_model
   use hb_properties, only: properties_t
   use hb_sweep_plan, only: sweep_plan_t
   use hb_system, only: coordinates_of
   use hb_text, only: lower, max_name, string_t
   implicit none
   private
   public :: advise_on_free_coordinates, advise_on_run, advise_on_size, advise_on_speed, varies_loads

   integer, parameter :: max_compared = 10000                         ! values of a sweep
   real(wp), parameter :: rounding = 1.0e-12_wp                       ! of a frequency that is zero

contains

   !> Adds all advice on a run; of the points of a sweep the first model is examined.
   subroutine advise_on_run(plan, document, model, list)
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(inout) :: document                     !! that was read
      type(model_t), intent(in) :: model                              !! that was made from it
      type(advice_list_t), intent(inout) :: list

      call advise_on_size(model, document, list)
      call advise_on_model(model%system, model%discretisation, model%options, list)
      call advise_on_speed(plan, document, list)
      call advise_on_values(plan, list)
   end subroutine advise_on_run

   !> Names a value of a sweep that is given twice in succession, other than for samples, which vary together, or the end of a range
   !> that one value leaves unused.
   subroutine advise_on_values(plan, list)
      type(sweep_plan_t), intent(in) :: plan
      type(advice_list_t), intent(inout) :: list
      integer :: i, k

      do i = 1, size(plan%parameters)
         associate (swept => plan%parameters(i), range => plan%parameters(i)%range)
            if (range%n == 1 .and. abs(range%last - range%first) > 0.0_wp) then
               call list%add(advice%unused_end, [real(wp) :: i, range%first, range%last])
               return
            end if
            if (swept%is_text .or. count(plan%parameters%axis == swept%axis) > 1) cycle
            do k = 2, min(swept%length(), max_compared)
               if (abs(swept%value(k) - swept%value(k - 1)) > 0.0_wp) cycle
               call list%add(advice%repeated_value, [real(wp) :: i, swept%value(k)], swept%path)
               return
            end do
         end associate
      end do
   end subroutine advise_on_values

   !> Whether a sweep or a curve varies a load, which may be zero in the input.
   logical function varies_loads(plan)
      type(sweep_plan_t), intent(in) :: plan
      character(:), allocatable :: path
      integer :: i

      varies_loads = any([(any(load_groups == plan%parameters(i)%group), i=1, size(plan%parameters))])
      if (.not. allocated(plan%curve)) return
      path = lower(trim(adjustl(plan%curve%path)))
      varies_loads = varies_loads .or. any(load_groups == path(:scan(path//"%", "(%") - 1))
   end function varies_loads

   !> Names a speed of a structure or element that is constant while the frequency of a tone moves.
   subroutine advise_on_speed(plan, document, list)
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(inout) :: document
      type(advice_list_t), intent(inout) :: list
      type(properties_t), pointer :: group
      type(parameter_t) :: moving
      character(*), parameter :: groups(*) = [character(max_name) :: "structure", element_groups]
      character(:), allocatable :: name, path, to
      real(wp) :: factor
      integer :: i

      i = findloc([(turns(trim(groups(i))), i=1, size(groups))], .true., dim=1)
      if (i == 0) return
      name = trim(groups(i))
      do i = 1, size(plan%parameters)
         associate (parameter => plan%parameters(i)%parameter)
            if (any(group_of(parameter) == groups) .and. parameter%key == "speed") return
            if (group_of(parameter) == "tones") moving = parameter
         end associate
      end do
      if (allocated(plan%curve)) then
         if (group_of(plan%curve%parameter) == "tones") moving = plan%curve%parameter
      end if
      if (moving%i_group == 0) return
      do i = 1, document%count("tie")
         group => document%group("tie", i)
         call group%get("parameter", path)
         if (index(path, "%speed") == 0) cycle
         call group%get("to", to)
         call group%get("factor", factor)
         if (index(to, "tones%hertz") == 1 .and. abs(factor - 1.0_wp) <= rounding) &
            call list%add(advice%factor_of_speed, [two_pi], path, to)
         return
      end do
      if (moving%key == "hertz") then
         call list%add(advice%constant_speed_in_hertz, [two_pi], name)
      else
         call list%add(advice%constant_speed, a=name)
      end if

   contains

      !> Whether a group has a speed; complete inputs have that of a structure at rest, too.
      logical function turns(name)
         character(*), intent(in) :: name
         type(properties_t), pointer :: group
         real(wp), allocatable :: speeds(:)
         integer :: k

         turns = .false.
         do k = 1, document%count(name)
            group => document%group(name, k)
            if (.not. group%given("speed")) cycle
            call group%get("speed", speeds)
            turns = turns .or. any(abs(speeds) > 0.0_wp)
         end do
      end function turns

      pure function group_of(parameter) result(name)
         type(parameter_t), intent(in) :: parameter
         character(max_name) :: name

         name = document%groups%holders(parameter%i_group)%group%name
      end function group_of
   end subroutine advise_on_speed

   !> Names degrees of freedom whose mean values nothing determines, so that they are zero.
   subroutine advise_on_free_coordinates(model, list)
      type(model_t), intent(in) :: model
      type(advice_list_t), intent(inout) :: list
      character(:), allocatable :: text
      type(amplitudes_t) :: no_loads
      type(coordinates_t) :: coordinates
      type(dynamic_stiffness_t) :: stiffness
      type(error_t), allocatable :: error
      type(linear_part_t) :: linear
      real(wp) :: frequencies(2)
      integer, allocatable :: dofs(:)
      integer :: i

      text = ""
      coordinates = coordinates_of(model%system)
      if (allocated(model%system%structure%sparse)) then
         if (pays_to_factorise(model%system%structure, coordinates)) return     ! the factor tells it
      end if
      frequencies = [0.0_wp, maxval(abs(model%discretisation%harmonics%frequencies(model%system%tones%omega)))]
      call new_amplitudes(no_loads, model%system%structure%n_dofs, size(frequencies))
      call new_dynamic_stiffness(stiffness, model%system%structure, coordinates, frequencies, no_loads, error, &
                                 wanted_slopes_t(of_interior=.false.), reshape([integer ::], [0, size(frequencies)]))
      if (allocated(error)) return
      dofs = stiffness%free_dofs
      if (coordinates%n > 0) then
         call new_linear_part(linear, stiffness)
         call linear%hold_free(frequencies, indifferent_coordinates(laws_at(coordinates, model%system%laws), coordinates%n))
         dofs = [dofs, pack(coordinates%positions, linear%is_free)]
      end if
      do i = 1, size(dofs)
         text = text//", '"//trim(model%system%structure%labels(dofs(i)))//"'"
      end do
      if (len(text) > 0) call list%add(advice%undetermined_mean, a=text(3:))
   end subroutine advise_on_free_coordinates

   !> Advises on a structure of type model that is large, or was reduced for lower frequencies, and on parts without equations in
   !> time.
   subroutine advise_on_size(model, document, list)
      type(model_t), intent(in) :: model
      type(document_t), intent(inout) :: document
      type(advice_list_t), intent(inout) :: list
      real(wp) :: highest
      integer :: i

      highest = maxval([0.0_wp, abs(model%discretisation%harmonics%frequencies(model%system%tones%omega))])
      associate (structure => model%system%structure)
         if (allocated(structure%parts)) then
            if (model%system%tones%n_tones > 1 .or. .not. all(structure%parts%is_known_growing())) then
               call list%add(advice%no_stability)
            else
               call list%add(advice%no_integration)
            end if
         end if
         if (structure%up_to > 0.0_wp .and. highest > structure%up_to) then
            call list%add(advice%above_reduction, [highest, structure%up_to])
         else if (allocated(structure%sparse) .and. allocated(structure%model_file) .and. .not. structure%up_to > 0.0_wp .and. &
                  2*sum([(size(model%system%laws(i)%law%dofs), i=1, size(model%system%laws))]) < structure%n_dofs .and. &
                  .not. has_factor(model)) then
            call list%add(advice%large_model, [real(wp) :: structure%n_dofs, ceiling(1.01_wp*highest)], structure%model_file, &
                          named_dofs(document))
         end if
      end associate
   end subroutine advise_on_size

   !> Whether points of a model have the factor of its whole stiffness; otherwise it is condensed to its contacts.
   logical function has_factor(model)
      type(model_t), intent(in) :: model
      type(coordinates_t) :: coordinates

      has_factor = allocated(model%system%structure%sparse) .and. size(model%options%gradient%by) == 0 .and. &
                   .not. any(model%system%tones%is_unknown)
      if (.not. has_factor) return
      coordinates = coordinates_of(model%system)
      has_factor = is_factorised(model%system%structure, coordinates, laws_at(coordinates, model%system%laws))
   end function has_factor

   !> Names of degrees of freedom and sets in an input, separated by commas.
   function named_dofs(document) result(text)
      type(document_t), intent(inout) :: document
      character(:), allocatable :: text
      character(*), parameter :: groups(*) = [character(max_name) :: "law", load_groups, "start", "output", "dynamic_stiffness", &
                                              element_groups, "normal_mode", "phase"]
      character(*), parameter :: keys(6) = [character(11) :: "dof", "dofs", "second_dofs", "normal_dofs", "force_dof", "force_dofs"]
      type(properties_t), pointer :: group
      type(string_t), allocatable :: names(:)
      integer :: g, i, k, n

      text = ""
      do g = 1, size(groups)
         do i = 1, document%count(trim(groups(g)))
            group => document%group(trim(groups(g)), i)
            do k = 1, size(keys)
               if (.not. group%given(trim(keys(k)))) cycle
               call group%get(trim(keys(k)), names)
               do n = 1, size(names)
                  if (index(","//text//",", ","//names(n)%value//",") == 0) text = text//","//names(n)%value
               end do
            end do
         end do
      end do
      text = text(2:)
   end function named_dofs
end module run_advice
