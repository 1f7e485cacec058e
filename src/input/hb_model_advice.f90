!> Advice on a model that can be solved, before it is: tones with a common period, no load, values that suggest a mistake.
module hb_model_advice
   use hb_advice, only: advice, advice_list_t
   use hb_common_divisor, only: common_divisor
   use hb_discretisation, only: discretisation_t
   use hb_error_estimate, only: near_commensurate
   use hb_harmonics, only: tuple_text
   use hb_kinds, only: two_pi, wp
   use hb_law, only: hold_t, law_t
   use hb_modes, only: find_natural_frequencies
   use hb_options, only: options_t
   use hb_pair_advice, only: advise_on_pairs
   use hb_sign_advice, only: advise_on_signs, is_gyrator, numbers_of
   use hb_structure, only: structure_t
   use hb_structure_load, only: is_only_in_time, load_box_t, structure_load_t
   use hb_system, only: system_t
   use hb_text, only: join, rounded_to, string_t, to_text
   use hb_tones, only: tones_t
   implicit none
   private
   public :: advise_on_combination, advise_on_drive, advise_on_model

   real(wp), parameter :: frequency_rounding = 1.0e-12_wp             ! of a frequency that is zero
   real(wp), parameter :: max_tone_ratio = 50.0_wp ! of a tone to the highest natural frequency, or of the lowest to it
   real(wp), parameter :: max_tolerance = 0.2_wp                      ! error of a motion
   real(wp), parameter :: max_length = 100.0_wp                       ! of a gap [m]
   integer, parameter :: n_known = 12                                 ! digits of a frequency, without rounding errors
   integer, parameter :: max_samples = 1000000                        ! which take a second of an iteration
   integer, parameter :: max_loads = 200                              ! which are compared in less than a millisecond
   integer, parameter :: max_dofs = 100                               ! of a structure whose natural frequencies take milliseconds
   character(*), parameter :: lengths(3) = [character(9) :: "clearance", "gap", "gaps"]

contains

   !> Advises on what drives a model: no load at all, tones with a common period.
   subroutine advise_on_drive(system, discretisation, options, list)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(advice_list_t), intent(inout) :: list

      call advise_on_combination(system%tones, options%error_estimate%commensurability, list)
      if (has_no_load(system)) call list%add(advice%no_load)
   end subroutine advise_on_drive

   !> Names values of a model that suggest a mistake: tones far above or below all natural frequencies, negative damping or
   !> stiffness, loads without damping, couplings without a counterpart, gaps that are very large or negative, repeated loads, a
   !> tolerance of a large part of the motion or beside given harmonics, a very large set of these.
   subroutine advise_on_model(system, discretisation, options, list)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(advice_list_t), intent(inout) :: list
      integer :: i

      call advise_on_tones(system, list)
      if (.not. allocated(system%structure%states)) call advise_on_signs(system, list)
      if (allocated(system%structure%sets%coordinates) .and. allocated(system%law_groups)) call advise_on_pairs(system, list)
      call advise_on_coupling("stiffness", system%structure%stiffness, system%structure, list)
      call advise_on_coupling("damping", system%structure%damping, system%structure, list)
      if (is_driven_without_losses(system, discretisation)) call list%add(advice%no_losses)
      do i = 1, size(system%laws)
         call advise_on_gaps(system%laws(i)%law, list)
      end do
      if (size(system%loads) <= max_loads) call advise_on_loads(system%loads, list)
      associate (accuracy => options%accuracy, n_samples => discretisation%torus%n_total)
         if (accuracy%is_on .and. accuracy%tolerance > max_tolerance) &
            call list%add(advice%large_tolerance, [accuracy%tolerance, 100.0_wp*accuracy%tolerance])
         if (accuracy%is_on .and. .not. accuracy%grows_set) call list%add(advice%given_harmonics)
         if (n_samples > max_samples .and. size(system%laws) > 0) &
            call list%add(advice%many_samples, [real(wp) :: discretisation%harmonics%n_harmonics, n_samples])
      end associate
   end subroutine advise_on_model

   !> Names the first coupling of two degrees of freedom in one direction alone: controllers may have such couplings, else
   !> half of a symmetric pair was forgotten. The force of a current and the voltage of a rate are two directions.
   pure subroutine advise_on_coupling(name, matrix, structure, list)
      character(*), intent(in) :: name                                !! of the matrix
      real(wp), intent(in), allocatable :: matrix(:, :)               !! (n_dofs, n_dofs); not allocated: sparse
      type(structure_t), intent(in) :: structure
      type(advice_list_t), intent(inout) :: list
      integer :: i, k

      if (.not. allocated(matrix) .or. allocated(structure%states)) return
      do k = 1, size(matrix, 2)
         do i = 1, size(matrix, 1)
            if (abs(matrix(k, i)) > 0.0_wp .or. .not. abs(matrix(i, k)) > 0.0_wp) cycle
            if (is_gyrator(structure, i, k)) cycle
            call list%add(advice%one_way_coupling, [matrix(i, k)], name, structure%labels(i), structure%labels(k))
            return
         end do
      end do
   end subroutine advise_on_coupling

   !> Names each load with an implausible number, and each that repeats a previous one.
   subroutine advise_on_loads(loads, list)
      type(load_box_t), intent(in) :: loads(:)
      type(advice_list_t), intent(inout) :: list
      integer :: i, k

      do i = 1, size(loads)
         call advise_on_phase(loads(i)%load, i, list)
         do k = 1, i - 1
            if (.not. loads(i)%load%repeats(loads(k)%load)) cycle
            call list%add(advice%repeated_load, [real(wp) :: k, i, loads(i)%load%tuple])
            exit
         end do
      end do
   end subroutine advise_on_loads

   !> Names a phase that seems to be in degrees.
   subroutine advise_on_phase(load, number, list)
      class(structure_load_t), intent(in) :: load
      integer, intent(in) :: number                                   !! of the load
      type(advice_list_t), intent(inout) :: list

      associate (phases => numbers_of(load, ["phase"]))
         if (any(abs(phases) > two_pi)) &
            call list%add(advice%phase_in_degrees, [phases(1)], "load "//to_text(number)//": phase")
      end associate
   end subroutine advise_on_phase

   !> Names a given tone that is far above all natural frequencies of the structure, or far below.
   subroutine advise_on_tones(system, list)
      type(system_t), intent(in) :: system
      type(advice_list_t), intent(inout) :: list
      real(wp), allocatable :: natural(:)
      real(wp) :: fastest, highest, lowest
      logical :: lacks_gyroscopic

      if (system%structure%n_dofs > max_dofs .or. allocated(system%structure%parts) .or. allocated(system%structure%states)) return
      if (all(system%tones%is_unknown)) return
      call find_natural_frequencies(system%structure, natural, lacks_gyroscopic)
      if (size(natural) == 0) return
      highest = maxval(natural)
      lowest = minval(natural)
      associate (tones => system%tones)
         fastest = maxval(tones%omega, mask=.not. tones%is_unknown)
         if (.not. (fastest > 0.0_wp .and. highest > frequency_rounding*fastest)) return
         associate (tone => rounded_to(tones%in_unit(fastest), n_known))
            if (fastest > max_tone_ratio*highest .and. .not. system%structure%up_to > 0.0_wp) then
               call list%add(advice%fast_tone, [tone, max_tone_ratio, rounded_to(tones%in_unit(highest), 4)], tones%unit())
            else if (fastest < lowest/max_tone_ratio .and. .not. any(tones%is_unknown)) then
               call list%add(advice%slow_tone, [tone, max_tone_ratio, rounded_to(tones%in_unit(lowest), 4)], tones%unit())
            else
               return
            end if
         end associate
      end associate
      if (lowest > 0.0_wp .and. fastest*highest*max_tone_ratio > 1.0_wp .and. fastest*lowest < max_tone_ratio) &
         call list%add(advice%exchanged_units)
   end subroutine advise_on_tones

   !> Names implausible gaps of a law.
   subroutine advise_on_gaps(law, list)
      class(law_t), intent(in) :: law
      type(advice_list_t), intent(inout) :: list
      integer :: k

      do k = 1, size(lengths)
         associate (gaps => [0.0_wp, numbers_of(law, lengths(k:k))])
            if (maxval(gaps) > max_length) call list%add(advice%gap_in_metres, [maxval(gaps)], law%label, lengths(k))
            if (minval(gaps) < 0.0_wp .and. lengths(k) == "gap") call list%add(advice%negative_gap, [minval(gaps)], law%label)
         end associate
      end do
   end subroutine advise_on_gaps

   !> Whether nothing drives the model: no load, no law that depends on tones, and no unknown tone of a self-excited
   !> motion. Without tones a free motion is integrated.
   pure logical function has_no_load(system)
      type(system_t), intent(in) :: system
      integer :: i

      has_no_load = system%tones%n_tones > 0 .and. .not. any(system%tones%is_unknown) .and. system%load_spectrum%is_zero() .and. &
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
      if (system%tones%n_tones == 0 .or. any(system%tones%is_unknown) .or. has_no_load(system)) return
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
   !> with fewer tones if it is zero.
   subroutine advise_on_combination(tones, limit, list)
      type(tones_t), intent(in) :: tones
      real(wp), intent(in) :: limit                                   !! relative to the largest tone
      type(advice_list_t), intent(inout) :: list
      integer, allocatable :: k(:)
      real(wp) :: frequency

      if (tones%n_tones < 2 .or. any(tones%is_unknown)) return
      call near_commensurate(tones, k, frequency)
      if (frequency > max(limit, frequency_rounding)*maxval(tones%omega)) return
      k = k/common_divisor(k)
      frequency = abs(dot_product(k, tones%omega))
      if (frequency > frequency_rounding*maxval(tones%omega)) then
         call list%add(advice%near_commensurate, [real(wp) :: tones%in_unit(frequency), k], list_of(tones), tones%unit())
      else
         call advise_on_fewer(tones, k, list)
      end if
   end subroutine advise_on_combination

   !> The model of fewer tones with the same loads, for k.omega = 0: one tone instead of all that are multiples of one frequency.
   subroutine advise_on_fewer(tones, k, list)
      type(tones_t), intent(in) :: tones
      integer, intent(in) :: k(:)
      type(advice_list_t), intent(inout) :: list
      integer, allocatable :: in_it(:), multiples(:), together(:)
      character(:), allocatable :: given, unit
      real(wp) :: common
      integer :: i, m

      in_it = pack([(i, i=1, size(k))], k /= 0)
      call find_multiples(tones%omega, in_it(1), together, multiples, common)
      common = rounded_to(tones%in_unit(common), n_known)
      m = findloc(abs(k(in_it)), 1, dim=1, back=.true.)
      given = list_of(tones)
      unit = tones%unit()
      if (size(together) == 2) then
         call list%add(advice%one_tone_of_two, [real(wp) :: common, multiples(1), together(1), multiples(2), together(2), k], &
                       given, unit)
      else if (size(together) > 2) then
         call list%add(advice%one_tone_of_many, [real(wp) :: common, k], given, unit, listed(multiples), listed(together))
      else if (m > 0) then
         m = in_it(m)
         call list%add(advice%dependent_tone, [real(wp) :: m, k], given, unit, &
                       tuple_text(-k(m)*pack(k, [(i /= m, i=1, size(k))])))
      else
         call list%add(advice%commensurate, [real(wp) :: k], given, unit)
      end if
      if (size(together) > 1 .and. all(multiples == 1)) call list%add(advice%equal_tones)
   end subroutine advise_on_fewer

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
         is_multiple = ratio < largest + 0.5_wp .and. abs(ratio - anint(ratio)) <= frequency_rounding*ratio .and. ratio > 0.5_wp
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

   !> The tones in the unit of the input, as a list.
   function list_of(tones) result(text)
      type(tones_t), intent(in) :: tones
      character(30*tones%n_tones + 5) :: text
      type(string_t) :: words(tones%n_tones)
      integer :: i

      do i = 1, tones%n_tones
         words(i)%value = to_text(tones%in_unit(tones%omega(i)))
      end do
      text = join(words(:tones%n_tones - 1), ", ")//" and "//words(tones%n_tones)%value
   end function list_of
end module hb_model_advice
