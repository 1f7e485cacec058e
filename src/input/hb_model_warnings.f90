!> Warnings about a model that can be solved, before it is: tones with a common period, no load, values that suggest a mistake.
module hb_model_warnings
   use hb_common_divisor, only: common_divisor
   use hb_discretisation, only: discretisation_t
   use hb_error_estimate, only: near_commensurate
   use hb_harmonics, only: tuple_text
   use hb_kinds, only: wp
   use hb_law, only: hold_t, law_t
   use hb_modes, only: find_natural_frequencies
   use hb_numbers, only: number_t
   use hb_options, only: options_t
   use hb_pair_warnings, only: describe_pairs
   use hb_sign_warnings, only: describe_signs, is_gyrator
   use hb_structure, only: structure_t
   use hb_structure_load, only: is_only_in_time, load_box_t
   use hb_system, only: system_t
   use hb_text, only: join, number_of, rounded_to, string_t, to_text
   use hb_tones, only: tones_t
   implicit none
   private
   public :: commensurate_text, describe_implausible, describe_warnings, has_no_load, no_load_text

   integer, parameter :: max_text = 1000                              ! length of a warning
   real(wp), parameter :: rounding = 1.0e-12_wp                       ! of a frequency that is zero
   real(wp), parameter :: max_tone_ratio = 50.0_wp ! of a tone to the highest natural frequency, or of the lowest to it
   real(wp), parameter :: max_tolerance = 0.2_wp                      ! error of a motion
   real(wp), parameter :: max_length = 100.0_wp                       ! of a gap [m]
   integer, parameter :: n_known = 12                                 ! digits of a frequency, without rounding errors
   integer, parameter :: max_samples = 1000000                        ! which take a second of an iteration
   integer, parameter :: max_loads = 200                              ! which are compared in less than a millisecond
   integer, parameter :: max_dofs = 100                               ! of a structure whose natural frequencies take milliseconds
   character(*), parameter :: lengths(3) = [character(9) :: "clearance", "gap", "gaps"]
   character(*), parameter :: no_load_text = "no load acts and no tone is unknown: only laws can cause a motion"

   character(*), parameter :: no_losses_text = "nothing dissipates energy, neither the structure nor a law: resonances have no "// &
      "limit, curves through them do not end, and stability remains unknown; give damping"

contains

   !> Lists the warnings about a model, one per line; none: an empty text.
   subroutine describe_warnings(system, discretisation, options, text)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      character(:), allocatable, intent(out) :: text

      call describe_implausible(system, discretisation, options, text)
      call add_line(text, trim(commensurate_text(system%tones, options%error_estimate%commensurability)))
      if (has_no_load(system, discretisation)) call add_line(text, no_load_text)
   end subroutine describe_warnings

   !> Lists values of a model that suggest a mistake, one per line: tones far above or below all natural frequencies, negative
   !> damping or stiffness, loads without damping, couplings without a counterpart, gaps that are very large or negative, repeated
   !> loads, a tolerance of a large part of the motion or beside given harmonics, a very large set of these; none: an empty text.
   subroutine describe_implausible(system, discretisation, options, text)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      character(:), allocatable, intent(out) :: text
      type(string_t), allocatable :: lines(:)
      integer :: i

      text = ""
      call describe_tones(system, text)
      call describe_signs(system, lines)
      do i = 1, size(lines)
         call add_line(text, lines(i)%value)
      end do
      call describe_pairs(system, lines)
      do i = 1, size(lines)
         call add_line(text, lines(i)%value)
      end do
      call describe_coupling("stiffness", system%structure%stiffness, system%structure, text)
      call describe_coupling("damping", system%structure%damping, system%structure, text)
      if (is_driven_without_losses(system, discretisation)) call add_line(text, no_losses_text)
      do i = 1, size(system%laws)
         call describe_gaps(system%laws(i)%law, text)
      end do
      if (size(system%loads) <= max_loads) call describe_loads(system%loads, text)
      if (options%accuracy%is_on .and. options%accuracy%tolerance > max_tolerance) call add_line(text, "tolerance = "// &
         to_text(options%accuracy%tolerance)//" allows errors of "//to_text(nint(100.0_wp*options%accuracy%tolerance))// &
         " % of the motion; 1 % is 1e-2")
      if (options%accuracy%is_on .and. .not. options%accuracy%grows_set) call add_line(text, "the harmonics are given, so that "// &
         "accuracy%tolerance chooses the samples alone; for harmonics by this tolerance, too, give no order and no set")
      if (discretisation%torus%n_total > max_samples .and. size(system%laws) > 0) call add_line(text, "given are "// &
         number_of(discretisation%harmonics%n_harmonics, "harmonic")//", with "//number_of(discretisation%torus%n_total, &
         "sample")//": a point may take minutes; a tolerance, instead of an order or a set, chooses those that are needed")
   end subroutine describe_implausible

   !> Adds a line on the first coupling of two degrees of freedom in one direction alone: controllers may have such couplings, else
   !> half of a symmetric pair was forgotten. The force of a current and the voltage of a rate are two directions.
   pure subroutine describe_coupling(name, matrix, structure, text)
      character(*), intent(in) :: name                                !! of the matrix
      real(wp), intent(in), allocatable :: matrix(:, :)               !! (n_dofs, n_dofs); not allocated: sparse
      type(structure_t), intent(in) :: structure
      character(:), allocatable, intent(inout) :: text
      integer :: i, k

      if (.not. allocated(matrix)) return
      do k = 1, size(matrix, 2)
         do i = 1, size(matrix, 1)
            if (abs(matrix(k, i)) > 0.0_wp .or. .not. abs(matrix(i, k)) > 0.0_wp) cycle
            if (is_gyrator(structure, i, k)) cycle
            associate (labels => structure%labels)
               call add_line(text, "the "//name//" matrix has an entry of row '"//trim(labels(i))//"' and column '"// &
                             trim(labels(k))//"', "//to_text(matrix(i, k))//", and none of row '"//trim(labels(k))// &
                             "' and column '"//trim(labels(i))//"': unless the coupling is to act in one direction, make the "// &
                             "matrix symmetric")
            end associate
            return
         end do
      end do
   end subroutine describe_coupling

   !> Adds a line on each load with an implausible number, and that repeats a previous one.
   pure subroutine describe_loads(loads, text)
      type(load_box_t), intent(in) :: loads(:)
      character(:), allocatable, intent(inout) :: text
      integer :: i, k

      do i = 1, size(loads)
         if (loads(i)%load%doubt() /= "") call add_line(text, "load "//to_text(i)//": "//trim(loads(i)%load%doubt()))
         do k = 1, i - 1
            if (.not. loads(i)%load%repeats(loads(k)%load)) cycle
            call add_line(text, "loads "//to_text(k)//" and "//to_text(i)//" act at the same place with the same tuple, "// &
                          trim(tuple_text(loads(i)%load%tuple))//": they are added; if one was to replace the other, remove it")
            exit
         end do
      end do
   end subroutine describe_loads

   !> Adds a line on given tones that are far above all natural frequencies of the structure, or far below.
   subroutine describe_tones(system, text)
      type(system_t), intent(in) :: system
      character(:), allocatable, intent(inout) :: text
      real(wp), allocatable :: natural(:)
      character(:), allocatable :: line, unit
      real(wp) :: fastest, highest, lowest
      logical :: lacks_gyroscopic

      if (system%structure%n_dofs > max_dofs .or. allocated(system%structure%parts)) return
      if (all(system%tones%is_unknown)) return
      call find_natural_frequencies(system%structure, natural, lacks_gyroscopic)
      if (size(natural) == 0) return
      highest = maxval(natural)
      lowest = minval(natural)
      associate (tones => system%tones)
         fastest = maxval(tones%omega, mask=.not. tones%is_unknown)
         if (.not. (fastest > 0.0_wp .and. highest > rounding*fastest)) return
         unit = " "//trim(tones%unit())
         if (fastest > max_tone_ratio*highest .and. .not. system%structure%up_to > 0.0_wp) then
            line = "a tone of "//to_text(rounded_to(tones%in_unit(fastest), n_known))//unit//" is more than "// &
                   to_text(nint(max_tone_ratio))//" times the highest natural frequency, "// &
                   to_text(rounded_to(tones%in_unit(highest), 4))//unit
         else if (fastest < lowest/max_tone_ratio .and. .not. any(tones%is_unknown)) then
            line = "the motion is nearly static: the lowest natural frequency, "// &
                   to_text(rounded_to(tones%in_unit(lowest), 4))//unit//", is more than "//to_text(nint(max_tone_ratio))// &
                   " times the tone of "//to_text(rounded_to(tones%in_unit(fastest), n_known))//unit
         else
            return
         end if
      end associate
      line = line//"; `frequency` is in rad/s, `hertz` in Hz"
      if (lowest > 0.0_wp) then
         if (fastest*highest*max_tone_ratio > 1.0_wp .and. fastest*lowest < max_tone_ratio) &
            line = line//"; are mass and stiffness exchanged?"
      end if
      call add_line(text, line)
   end subroutine describe_tones

   !> Adds lines on gaps of a law.
   subroutine describe_gaps(given, text)
      class(law_t), intent(in) :: given
      character(:), allocatable, intent(inout) :: text
      class(law_t), allocatable :: law
      type(number_t), allocatable :: numbers(:)
      real(wp) :: largest, lowest, value
      logical :: is_found
      integer :: i, k

      allocate (law, source=given)
      call law%list_numbers(numbers)
      do k = 1, size(lengths)
         largest = 0.0_wp
         lowest = 0.0_wp
         do i = 1, size(numbers)
            if (numbers(i)%key /= lengths(k)) cycle
            call law%find_number(numbers(i), value, is_found)
            if (.not. is_found) cycle
            largest = max(largest, value)
            lowest = min(lowest, value)
         end do
         if (largest > max_length) call add_line(text, "law '"//law%label//"': "//trim(lengths(k))//" = "//to_text(largest)// &
            " m; lengths are in metres, 1 mm = 1e-3")
         if (lowest < 0.0_wp .and. lengths(k) == "gap") call add_line(text, "law '"//law%label//"': gap = "//to_text(lowest)// &
            " m is negative: in contact and preloaded at rest; for a stop on the other side: weights = -1, and a positive gap")
      end do
   end subroutine describe_gaps

   pure subroutine add_line(text, line)
      character(:), allocatable, intent(inout) :: text
      character(*), intent(in) :: line

      if (len(line) == 0) return
      if (len(text) > 0) text = text//new_line("a")
      text = text//line
   end subroutine add_line

   !> Whether nothing drives the model: no load, no law that depends on tones, and no unknown tone of a self-excited
   !> motion. Without tones a free motion is integrated.
   pure logical function has_no_load(system, discretisation)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      integer :: i

      has_no_load = system%tones%n_tones > 0 .and. .not. any(system%tones%is_unknown) .and. discretisation%loads%is_zero() .and. &
                    .not. any(is_only_in_time(system%loads)) .and. &
                    .not. any([(allocated(system%laws(i)%law%modulation), i=1, size(system%laws))])
   end function has_no_load

   !> Whether loads drive a model in which nothing dissipates energy. Of laws with rates, memory or unknown contents it is assumed
   !> that they do.
   logical function is_driven_without_losses(system, discretisation) result(is_driven)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(hold_t) :: hold
      real(wp), allocatable :: damping(:), mass(:), stiffness(:)      ! diagonals
      integer :: i

      is_driven = .false.
      if (system%tones%n_tones == 0 .or. any(system%tones%is_unknown) .or. has_no_load(system, discretisation)) return
      if (allocated(system%structure%parts)) return
      call system%structure%diagonals(mass, damping, stiffness)
      if (all(abs(mass) <= 0.0_wp) .or. any(abs(damping) > 0.0_wp)) return
      do i = 1, size(system%laws)
         associate (law => system%laws(i)%law)
            if (law%needs_velocity .or. law%n_states > 0 .or. law%is_users_own) return
            if (law%n_phases > 0 .or. law%needs_frequencies) return
            if (.not. law%is_multiplier) cycle
            hold = law%hold()
            if (hold%restitution >= 0.0_wp .and. hold%restitution < 1.0_wp) return
         end associate
      end do
      is_driven = .true.
   end function is_driven_without_losses

   !> Names a combination of given tones with a frequency below `limit` times the largest, and the equivalent model
   !> with fewer tones if it is zero; empty if there is none.
   function commensurate_text(tones, limit) result(text)
      type(tones_t), intent(in) :: tones
      real(wp), intent(in) :: limit                                   !! relative to the largest tone
      character(max_text) :: text
      integer, allocatable :: k(:)
      real(wp) :: frequency

      text = ""
      if (tones%n_tones < 2 .or. any(tones%is_unknown)) return
      call near_commensurate(tones, k, frequency)
      if (frequency > max(limit, rounding)*maxval(tones%omega)) return
      k = k/common_divisor(k)
      frequency = abs(dot_product(k, tones%omega))
      text = "tones "//trim(list_of(tones%in_unit(tones%omega)))//" "//trim(tones%unit())//": their combination "// &
             tuple_text(k)//" has the frequency "
      if (frequency > rounding*maxval(tones%omega)) then
         text = trim(text)//" "//to_text(tones%in_unit(frequency))//" "//trim(tones%unit())//"; such tones are nearly commensurate"
      else
         text = trim(text)//" 0; "//model_of_fewer(tones, k)
      end if
   end function commensurate_text

   !> The model of fewer tones with the same loads, for k.omega = 0: one tone instead of all that are multiples of one frequency.
   function model_of_fewer(tones, k) result(text)
      type(tones_t), intent(in) :: tones
      integer, intent(in) :: k(:)
      character(max_text) :: text
      integer, allocatable :: in_it(:), multiples(:), together(:)
      real(wp) :: common
      integer :: i, m

      in_it = pack([(i, i=1, size(k))], k /= 0)
      call find_multiples(tones%omega, in_it(1), together, multiples, common)
      m = findloc(abs(k(in_it)), 1, dim=1, back=.true.)
      if (size(together) > 1) then
         text = "use one tone of "//to_text(rounded_to(tones%in_unit(common), n_known))//" "//trim(tones%unit())//" instead"
         if (size(together) == 2) text = trim(text)//" of both, with tuple "//to_text(multiples(1))//" for loads of tone "// &
            to_text(together(1))//" and "//to_text(multiples(2))//" for those of tone "//to_text(together(2))
         if (size(together) > 2) text = trim(text)//", with the tuples "//trim(listed(multiples))//" for loads of the tones "// &
            trim(listed(together))
         if (all(multiples == 1)) text = trim(text)//"; 2*3.14 in an input is 3.14 twice"
      else if (m > 0) then
         m = in_it(m)
         text = "leave out tone "//to_text(m)//", and give its loads the tuple "// &
            tuple_text(-k(m)*pack(k, [(i /= m, i=1, size(k))]))//" of the others"
      else
         text = "fewer tones, of which these are integer combinations, give the same motion"
      end if
   end function model_of_fewer

   !> The tones that are small multiples of one frequency, as a tone is; this one alone if no other is.
   pure subroutine find_multiples(omega, of, found, multiples, common)
      real(wp), intent(in) :: omega(:)                                !! [rad/s]
      integer, intent(in) :: of                                       !! tone
      integer, allocatable, intent(out) :: found(:)                   !! tones
      integer, allocatable, intent(out) :: multiples(:)               !! each of them, relative to the common frequency
      real(wp), intent(out) :: common                                 !! frequency [rad/s]
      integer, parameter :: max_multiple = 60                         ! multiple
      integer :: i, most, n

      most = 0
      do n = 1, max_multiple                                          ! the common frequency is the n-th part of the tone
         associate (fits => is_multiple(omega, omega(of)/n, max_multiple))
            if (count(fits) <= most) cycle
            most = count(fits)
            found = pack([(i, i=1, size(omega))], fits)
            common = omega(of)/n
         end associate
      end do
      multiples = nint(omega(found)/common)
   end subroutine find_multiples

   !> Whether a frequency is a multiple of a common one, up to rounding.
   elemental logical function is_multiple(omega, common, largest)
      real(wp), intent(in) :: omega, common
      integer, intent(in) :: largest

      associate (ratio => omega/common)
         is_multiple = ratio < largest + 0.5_wp .and. abs(ratio - anint(ratio)) <= rounding*ratio .and. ratio > 0.5_wp
      end associate
   end function is_multiple

   !> Numbers as a list: 2, 3 and 6.
   pure function listed(numbers) result(text)
      integer, intent(in) :: numbers(:)
      character(12*size(numbers) + 5) :: text
      integer :: i

      text = to_text(numbers(1))
      do i = 2, size(numbers)
         text = trim(text)//trim(merge(" and", ",   ", i == size(numbers)))//" "//to_text(numbers(i))
      end do
   end function listed

   function list_of(omega) result(text)
      real(wp), intent(in) :: omega(:)
      character(30*size(omega) + 5) :: text
      type(string_t) :: words(size(omega))
      integer :: i

      do i = 1, size(omega)
         words(i)%value = to_text(omega(i))
      end do
      text = join(words(:size(omega) - 1), ", ")//" and "//words(size(omega))%value
   end function list_of
end module hb_model_warnings
