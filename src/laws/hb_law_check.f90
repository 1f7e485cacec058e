!> Compares the derivatives of a law with central differences of its forces, and a law that is declared odd with its mirror image.
!> The samples are random, with magnitudes over several decades; if differences with two step sizes disagree (because
!> of a kink or of rounding), a sample is skipped, otherwise they are extrapolated to step zero. Source: Richardson,
!> Philos. Trans. R. Soc. London A 210 (1911) 307-357.
module hb_law_check
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_text, only: join, rounded, string_t, to_text
   implicit none
   private
   public :: check_derivatives, check_derivatives_at, derivative_check_t, derivative_tolerance, find_fault, find_fault_of_memory, &
      mixed_samples

   integer, parameter :: n_samples = 400
   real(wp), parameter :: coarse_step = 1.0e-5_wp                     ! relative to the magnitude of a sample
   real(wp), parameter :: difference_agreement = 1.0e-6_wp            ! of both differences, relative
   real(wp), parameter :: rounding_units = 20.0_wp                    ! units in the last place: rounding of a force
   real(wp), parameter :: derivative_tolerance = 1.0e-5_wp            !! relative difference above which a derivative is wrong

   !> The results of a check.
   type :: derivative_check_t
      real(wp) :: difference = 0.0_wp                                 !! largest, relative to the derivative
      integer :: n_compared = 0                                       !! samples, counted for each derivative
      integer :: n_skipped = 0                                        !! of these, near a kink or without a finite force
      type(string_t), allocatable :: wrong(:)                         !! derivatives that are wrong, such as df/dz
      logical :: is_repeatable = .true.                               !! equal samples give equal forces and derivatives
      logical :: has_touched_inputs = .false.                         !! code of the user has modified its inputs
      logical :: is_wrongly_odd = .false.                       !! it is declared odd, and its forces are not
      logical :: mixes_samples = .false.                        !! the force of a sample depends on other samples
   contains
      procedure :: is_sound => derivative_check_is_sound
      procedure :: describe => derivative_check_describe
   end type derivative_check_t

   !> Samples z, rates v and reactions p, their magnitudes, and the phases of the tones; or steps of laws with memory.
   type :: samples_t
      real(wp), allocatable :: motion(:, :, :)                        ! (n_samples, n_coordinates, z v p); of steps the parts of the
                                                                      ! path, then the states before
      real(wp), allocatable :: magnitude(:, :)                        ! (n_samples, z v p)
      real(wp), allocatable :: phases(:, :)                           ! [rad], (n_tones, n_samples)
      real(wp) :: least_slope = 0.0_wp                                ! of the largest: smaller ones need no digits of their own
   end type samples_t

   character(1), parameter :: letters(3) = ["z", "v", "p"]
   !> What is wrong with a law that mixes samples.
   character(*), parameter :: mixed_samples = "the force of a sample depends on other samples: an axis of samples was taken "// &
      "for one of coordinates, or a sum was taken over it"

contains

   !> Checks all derivatives of a law. Its parameters that depend on the structure are those for a static stiffness of
   !> 1 N/m and an impedance of 1 N s/m.
   subroutine check_derivatives(unprepared_law, check, tones)
      class(law_t), intent(in) :: unprepared_law
      type(derivative_check_t), intent(out) :: check
      integer, intent(in), optional :: tones                          !! their number; default: as many as the law requires
      class(law_t), allocatable :: law
      type(samples_t) :: samples
      integer :: i, n_tones

      allocate (law, source=unprepared_law)
      n_tones = law%n_phases
      if (present(tones)) n_tones = tones
      call law%prepare(1.0_wp)
      call law%prepare_rate(1.0_wp, 1.0_wp)
      call choose_samples(law, n_tones, samples)
      if (law%n_phases > 0) call law%set_phases(samples%phases)
      call law%set_frequencies([(1.0_wp, i=1, n_tones)])
      call compare(law, samples, check)
   end subroutine check_derivatives

   !> Checks the derivatives of a law at given samples, such as those of a motion.
   subroutine check_derivatives_at(given, z, v, phases, omega, check)
      class(law_t), intent(in) :: given                               !! prepared; without reactions
      real(wp), intent(in) :: z(:, :), v(:, :)                        !! (n_samples, n_coordinates)
      real(wp), intent(in) :: phases(:, :)                            !! [rad], (n_tones, n_samples)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      type(derivative_check_t), intent(out) :: check
      real(wp), parameter :: min_sample_ratio = 1.0e-3_wp             ! part of the largest sample that is a magnitude at least
      real(wp), parameter :: small_slope = 1.0e-4_wp                  ! where a force is flat, differences have no digits
      class(law_t), allocatable :: law
      type(samples_t) :: samples

      allocate (law, source=given)
      allocate (samples%motion(size(z, 1), size(z, 2), 3), source=0.0_wp)
      allocate (samples%magnitude(size(z, 1), 3), source=1.0_wp)
      samples%motion(:, :, 1) = z
      samples%motion(:, :, 2) = v
      samples%magnitude(:, 1) = magnitude_of(z)
      samples%magnitude(:, 2) = magnitude_of(v)
      samples%phases = phases
      samples%least_slope = small_slope
      if (law%n_phases > 0) call law%set_phases(phases)
      call law%set_frequencies(omega)
      call compare(law, samples, check)

   contains

      pure function magnitude_of(x) result(magnitude)
         real(wp), intent(in) :: x(:, :)
         real(wp) :: magnitude(size(x, 1))
         real(wp) :: largest

         largest = maxval(abs(x))
         if (.not. largest > 0.0_wp) largest = 1.0_wp
         magnitude = max(maxval(abs(x), dim=2), min_sample_ratio*largest)
      end function magnitude_of
   end subroutine check_derivatives_at

   !> Compares all derivatives of a law at samples.
   subroutine compare(law, samples, check)
      class(law_t), intent(in) :: law
      type(samples_t), intent(in) :: samples
      type(derivative_check_t), intent(inout) :: check
      real(wp), allocatable :: f(:, :), f_again(:, :), slopes(:, :, :, :), slopes_again(:, :, :, :)
      integer :: b, kind_of_motion, m, n

      m = size(samples%motion, 1)
      n = size(law%shape, 2)
      allocate (check%wrong(0), f(m, n))
      allocate (slopes(m, n, n, 3))
      call evaluate(law, samples, f, slopes)
      allocate (f_again, mold=f)
      allocate (slopes_again, mold=slopes)
      call evaluate(law, samples, f_again, slopes_again)
      check%is_repeatable = are_the_same(reshape(f, [size(f)]), reshape(f_again, [size(f)])) .and. &
         are_the_same(reshape(slopes, [size(slopes)]), reshape(slopes_again, [size(slopes)]))
      check%mixes_samples = mixes(law, samples, f)
      check%has_touched_inputs = law%has_touched_inputs(samples%motion(:, :, 1), &
         samples%motion(:, :merge(n, 0, law%needs_velocity), 2))
      if (law%is_odd .and. law%n_states == 0) check%is_wrongly_odd = .not. is_mirrored(law, samples, f)
      do kind_of_motion = 1, 3
         if (.not. depends_on(law, kind_of_motion)) cycle
         do b = 1, n
            call check_column(law, samples, kind_of_motion, b, slopes(:, :, b, kind_of_motion), check)
         end do
      end do
   end subroutine compare

   !> Whether some of the samples, in an irregular order, have other forces than f: sums over half of a symmetric motion may be
   !> those over all of it.
   logical function mixes(law, samples, f)
      class(law_t), intent(in) :: law
      type(samples_t), intent(in) :: samples
      real(wp), intent(in) :: f(:, :)                                 !! of all samples, (n_samples, n_coordinates)
      real(wp), parameter :: golden_ratio = 0.6180339887498949_wp
      class(law_t), allocatable :: alone
      type(samples_t) :: half
      integer :: order(size(f, 1) - size(f, 1)/2), i
      real(wp) :: f_half(size(order), size(f, 2))

      order = [(1 + int(size(f, 1)*modulo(real(i, wp)**2*golden_ratio, 1.0_wp)), i=1, size(order))]
      half = selected(samples, order)
      allocate (alone, source=law)
      if (law%n_phases > 0) call alone%set_phases(half%phases)
      call evaluate(alone, half, f_half)
      mixes = .not. are_the_same(reshape(f(order, :), [size(f_half)]), reshape(f_half, [size(f_half)]))
   end function mixes

   !> Why no method can follow the forces of a law along a motion: they depend on other samples, or jump between two samples. Empty
   !> where nothing of that is found.
   subroutine find_fault(law, z, v, phases, fault)
      class(law_t), intent(in) :: law                                 !! prepared; without states and reactions
      real(wp), intent(in) :: z(:, :), v(:, :)                        !! along the motion, (n_samples, n_coordinates)
      real(wp), intent(in) :: phases(:, :)                            !! [rad], (n_tones, n_samples); used if the law needs them
      character(:), allocatable, intent(out) :: fault
      type(samples_t) :: samples

      allocate (samples%motion(size(z, 1), size(z, 2), 3), source=0.0_wp)
      samples%motion(:, :, 1) = z
      samples%motion(:, :, 2) = v
      samples%phases = phases
      call find_fault_at(law, samples, fault)
   end subroutine find_fault

   !> The same of a law with memory: of its states at the end of a step, and of the forces there.
   subroutine find_fault_of_memory(law, path, states, fault)
      class(hysteretic_law_t), intent(in) :: law
      real(wp), intent(in) :: path(:, :, :)                           !! of steps that follow each other, (n_samples, n_coordinates,
                                                                      !! n_path_parts)
      real(wp), intent(in) :: states(:, :)                            !! before each of them, (n_samples, n_states)
      character(:), allocatable, intent(out) :: fault
      type(samples_t) :: samples

      allocate (samples%motion(size(path, 1), max(size(path, 2), size(states, 2)), n_path_parts + 1), source=0.0_wp)
      samples%motion(:, :size(path, 2), :n_path_parts) = path
      samples%motion(:, :size(states, 2), n_path_parts + 1) = states
      allocate (samples%phases(0, size(path, 1)))
      call find_fault_at(law, samples, fault)
   end subroutine find_fault_of_memory

   subroutine find_fault_at(law, samples, fault)
      class(law_t), intent(in) :: law
      type(samples_t), intent(inout) :: samples                       !! without magnitudes
      character(:), allocatable, intent(out) :: fault
      real(wp), parameter :: min_relative_jump = 1.0e-3_wp            ! jump, relative to the largest force
      real(wp) :: at(2), f(size(samples%motion, 1), size(law%shape, 2)), jump

      fault = ""
      allocate (samples%magnitude(size(f, 1), 3), source=1.0_wp)
      call evaluate(law, samples, f)
      if (.not. all(ieee_is_finite(f))) return
      if (mixes(law, samples, f)) then
         fault = mixed_samples
         return
      end if
      call find_jump(law, samples, jump, at)
      if (.not. jump > min_relative_jump*maxval(abs(f))) return
      fault = "its force jumps by "//rounded(jump)//" where a displacement is "//rounded(at(1))
      if (law%needs_velocity) fault = fault//" and its rate "//rounded(at(2))
      fault = fault//": no motion of finitely many harmonics is in balance with it. Use coulomb_rigid or jenkins for dry "// &
              "friction, rigid_wall for a wall; smooth other jumps, as by tanh over a thousandth of the largest motion"
   end subroutine find_fault_at

   !> The largest jump of the force between two samples that follow each other, at the phases of the first, by bisection to
   !> neighbouring numbers.
   subroutine find_jump(law, samples, jump, at)
      class(law_t), intent(in) :: law
      type(samples_t), intent(in) :: samples
      real(wp), intent(out) :: jump                                   !! 0: none
      real(wp), intent(out) :: at(2)                                  !! displacement and rate there, of one coordinate
      integer, parameter :: n_bisections = 60, max_intervals = 256
      class(law_t), allocatable :: held
      type(samples_t) :: first, next
      real(wp), allocatable, dimension(:, :, :) :: higher, lower, middle
      real(wp), allocatable, dimension(:, :) :: f_higher, f_lower, f_middle
      integer :: i, k, n, place(2)

      jump = 0.0_wp
      at = 0.0_wp
      n = size(samples%motion, 1)
      if (n < 2) return
      associate (m => min(n - 1, max_intervals))
         first = selected(samples, [(1 + ((i - 1)*(n - 1))/m, i=1, m)])
         next = selected(samples, [(1 + (i*(n - 1))/m, i=1, m)])
      end associate
      lower = first%motion
      higher = next%motion
      allocate (held, source=law)
      if (law%n_phases > 0) call held%set_phases(first%phases)         ! a force may jump at given times
      allocate (f_lower(size(lower, 1), size(law%shape, 2)))
      f_higher = f_lower
      f_middle = f_lower
      call evaluate_block(held, lower, f_lower)
      call evaluate_block(held, higher, f_higher)
      do k = 1, n_bisections
         middle = 0.5_wp*(lower + higher)
         call evaluate_block(held, middle, f_middle)
         if (.not. all(ieee_is_finite(f_middle))) return
         do i = 1, size(middle, 1)
            if (maxval(abs(f_higher(i, :) - f_middle(i, :))) > maxval(abs(f_middle(i, :) - f_lower(i, :)))) then
               lower(i, :, :) = middle(i, :, :)
               f_lower(i, :) = f_middle(i, :)
            else
               higher(i, :, :) = middle(i, :, :)
               f_higher(i, :) = f_middle(i, :)
            end if
         end do
      end do
      place = maxloc(abs(f_higher - f_lower))
      jump = abs(f_higher(place(1), place(2)) - f_lower(place(1), place(2)))
      at = middle(place(1), place(2), :2)
   end subroutine find_jump

   !> Some of the samples.
   pure type(samples_t) function selected(samples, positions) result(some)
      type(samples_t), intent(in) :: samples
      integer, intent(in) :: positions(:)

      allocate (some%motion(size(positions), size(samples%motion, 2), size(samples%motion, 3)), &
                some%magnitude(size(positions), size(samples%magnitude, 2)), some%phases(size(samples%phases, 1), size(positions)))
      some%motion(:, :, :) = samples%motion(positions, :, :)
      some%magnitude(:, :) = samples%magnitude(positions, :)
      some%phases(:, :) = samples%phases(:, positions)
   end function selected

   !> Whether the forces f of samples change their sign with that of the motion.
   logical function is_mirrored(law, samples, f)
      class(law_t), intent(in) :: law
      type(samples_t), intent(in) :: samples
      real(wp), intent(in) :: f(:, :)                                 !! (n_samples, n_coordinates)
      real(wp), parameter :: force_rounding = 1.0e-12_wp              ! of the largest force
      type(samples_t) :: mirrored
      real(wp) :: f_mirrored(size(f, 1), size(f, 2)), size_of_sample(size(f, 1))
      integer :: a

      mirrored = samples
      mirrored%motion = -samples%motion
      call evaluate(law, mirrored, f_mirrored)
      size_of_sample = max(largest(f), largest(f_mirrored))
      is_mirrored = .true.
      do a = 1, size(f, 2)
         is_mirrored = is_mirrored .and. .not. any(ieee_is_finite(f(:, a)) .and. ieee_is_finite(f_mirrored(:, a)) .and. &
            abs(f(:, a) + f_mirrored(:, a)) > derivative_tolerance*size_of_sample + force_rounding*maxval(size_of_sample))
      end do
   end function is_mirrored

   !> Whether the law may be used: its derivatives agree with its forces, and the comparison was possible.
   pure logical function derivative_check_is_sound(self) result(is_sound)
      class(derivative_check_t), intent(in) :: self

      is_sound = self%is_repeatable .and. .not. (self%has_touched_inputs .or. self%mixes_samples .or. self%is_wrongly_odd) .and. &
         size(self%wrong) == 0 .and. self%n_skipped < self%n_compared
   end function derivative_check_is_sound

   !> Describes the result.
   subroutine derivative_check_describe(self, verdict)
      class(derivative_check_t), intent(in) :: self
      character(:), allocatable, intent(out) :: verdict

      if (self%has_touched_inputs) then
         verdict = "wrong: it writes to its inputs"
      else if (.not. self%is_repeatable) then
         verdict = "wrong: two evaluations of the same motion differ"
      else if (self%mixes_samples) then
         verdict = "wrong: "//mixed_samples
      else if (size(self%wrong) > 0) then
         verdict = "wrong: "//join(self%wrong, ", ")
      else if (self%is_wrongly_odd) then
         verdict = "wrong: declared odd, but f(-z, -v) is not -f(z, v)"
      else if (self%n_skipped == self%n_compared) then
         verdict = "not known: no sample could be compared"
      else
         verdict = "right"
      end if
   end subroutine derivative_check_describe

   !> Whether two results agree up to rounding; NaN agrees with NaN.
   pure logical function are_the_same(a, b)
      real(wp), intent(in) :: a(:), b(:)
      real(wp), parameter :: force_rounding = 1.0e-12_wp
      logical :: is_number(size(a))

      is_number = ieee_is_finite(a)
      are_the_same = all(is_number .eqv. ieee_is_finite(b))
      if (.not. (are_the_same .and. any(is_number))) return
      are_the_same = maxval(abs(pack(a, is_number) - pack(b, is_number))) <= force_rounding*maxval(abs(pack(a, is_number)))
   end function are_the_same

   !> Whether the law depends on this kind of motion: 1 displacement, 2 rate, 3 reaction.
   pure logical function depends_on(law, kind_of_motion)
      class(law_t), intent(in) :: law
      integer, intent(in) :: kind_of_motion

      select case (kind_of_motion)
      case (2); depends_on = law%needs_velocity
      case (3); depends_on = law%is_multiplier
      case default; depends_on = .true.
      end select
   end function depends_on

   !> Chooses numbers between -1 and 1 times a length of the law (1 m, 1 m/s, 1 N without one) times a power of ten,
   !> equal in every call.
   subroutine choose_samples(law, n_tones, samples)
      class(law_t), intent(in) :: law
      integer, intent(in) :: n_tones
      type(samples_t), intent(out) :: samples
      real(wp), parameter :: decades_of_length(2) = [-2.0_wp, 1.0_wp]
      integer, allocatable :: seed(:), seed_before(:)
      integer :: c, i, kind_of_motion, n
      real(wp) :: length

      call random_seed(size=n)
      allocate (seed_before(n))
      call random_seed(get=seed_before)
      seed = [(104729*i, i=1, n)]
      call random_seed(put=seed)
      allocate (samples%motion(n_samples, size(law%shape, 2), 3), samples%magnitude(n_samples, 3))
      call random_number(samples%motion)
      call random_number(samples%magnitude)
      samples%phases = spread(100.0_wp*[(real(i, wp), i=1, n_samples)], 1, n_tones)   ! distributed over the circle
      call random_seed(put=seed_before)
      length = law%length_scale
      if (length <= 0.0_wp) length = 1.0_wp
      samples%magnitude = length*10.0_wp**(decades_of_length(1) + (decades_of_length(2) - decades_of_length(1))*samples%magnitude)
      samples%motion = 2.0_wp*samples%motion - 1.0_wp
      do kind_of_motion = 1, 3
         do c = 1, size(samples%motion, 2)
            samples%motion(:, c, kind_of_motion) = samples%magnitude(:, kind_of_motion)*samples%motion(:, c, kind_of_motion)
         end do
      end do
   end subroutine choose_samples

   !> Compares the derivatives of all forces with respect to the displacement, rate or reaction of one coordinate.
   subroutine check_column(law, samples, kind_of_motion, b, slope, check)
      class(law_t), intent(in) :: law
      type(samples_t), intent(in) :: samples
      integer, intent(in) :: kind_of_motion, b
      real(wp), intent(in) :: slope(:, :)                             !! (n_samples, n_coordinates)
      type(derivative_check_t), intent(inout) :: check
      real(wp), dimension(size(slope, 1), size(slope, 2)) :: coarse, fine, noise
      real(wp) :: difference, tolerable(size(slope, 2)), worst(size(slope, 2))
      type(string_t) :: name
      integer :: a, i
      logical :: agrees

      call central_difference(law, samples, kind_of_motion, b, coarse_step, coarse, noise)
      call central_difference(law, samples, kind_of_motion, b, coarse_step/2, fine, noise)
      tolerable = derivative_tolerance*samples%least_slope*maxval(abs(slope), 1, ieee_is_finite(slope))
      worst = 0.0_wp
      do i = 1, size(slope, 1)
         check%n_compared = check%n_compared + 1
         agrees = all(ieee_is_finite(coarse(i, :))) .and. all(ieee_is_finite(fine(i, :)))
         if (agrees) agrees = all(abs(coarse(i, :) - fine(i, :)) <= difference_agreement*abs(fine(i, :)) + noise(i, :))
         if (.not. agrees) then
            check%n_skipped = check%n_skipped + 1
            cycle
         end if
         do a = 1, size(slope, 2)
            difference = relative_difference((4.0_wp*fine(i, a) - coarse(i, a))/3.0_wp, slope(i, a), &
                                             max(noise(i, a), tolerable(a)))
            worst(a) = max(worst(a), difference)
         end do
      end do
      do a = 1, size(slope, 2)
         check%difference = max(check%difference, worst(a))
         if (worst(a) > derivative_tolerance) then
            name%value = trim(name_of(a, letters(kind_of_motion), b, size(slope, 2)))
            check%wrong = [check%wrong, name]
         end if
      end do
   end subroutine check_column

   !> Difference relative to the larger of both, or to a value for which the rounding error alone is tolerable. Two
   !> derivatives without a finite value give 1e300.
   pure real(wp) function relative_difference(expected, found, noise)
      real(wp), intent(in) :: expected, found, noise

      if (.not. ieee_is_finite(found)) then
         relative_difference = 1.0e300_wp
      else if (found == expected) then
         relative_difference = 0.0_wp
      else
         relative_difference = abs(found - expected)/max(abs(found), abs(expected), noise/derivative_tolerance)
      end if
   end function relative_difference

   !> Name of a derivative, such as df/dz, with several coordinates df(1)/dz(2).
   pure function name_of(a, letter, b, n) result(name)
      integer, intent(in) :: a, b, n
      character(1), intent(in) :: letter
      character(40) :: name

      name = "df/d"//letter
      if (n > 1) name = "df("//to_text(a)//")/d"//letter//"("//to_text(b)//")"
   end function name_of

   !> Computes (f(x + h) - f(x - h))/(2 h) with h relative to the magnitude of each sample, and a bound of its
   !> rounding error: from units in the last place of the largest force of the sample, because terms common to all
   !> forces may cancel in one of them, and of the product of the law's length and slope, because the forces of
   !> preloaded springs may balance each other.
   subroutine central_difference(law, samples, kind_of_motion, b, relative_step, quotient, noise)
      class(law_t), intent(in) :: law
      type(samples_t), intent(in) :: samples
      integer, intent(in) :: kind_of_motion, b
      real(wp), intent(in) :: relative_step
      real(wp), intent(out) :: quotient(:, :), noise(:, :)            !! (n_samples, n_coordinates)
      type(samples_t) :: moved
      real(wp), dimension(size(quotient, 1), size(quotient, 2)) :: higher, lower
      real(wp) :: h(size(quotient, 1))

      h = relative_step*samples%magnitude(:, kind_of_motion)
      moved = samples
      moved%motion(:, b, kind_of_motion) = samples%motion(:, b, kind_of_motion) + h
      call evaluate(law, moved, higher)
      moved%motion(:, b, kind_of_motion) = samples%motion(:, b, kind_of_motion) - h
      call evaluate(law, moved, lower)
      quotient = (higher - lower)/spread(2.0_wp*h, 2, size(quotient, 2))
      noise = spread(rounding_units*epsilon(1.0_wp)*(largest(higher) + largest(lower) + law%length_scale*largest(quotient))/h, 2, &
                     size(quotient, 2))
   end subroutine central_difference

   !> Largest finite magnitude of each sample.
   pure function largest(forces)
      real(wp), intent(in) :: forces(:, :)                            !! (n_samples, n_coordinates)
      real(wp) :: largest(size(forces, 1))
      integer :: a

      largest = 0.0_wp
      do a = 1, size(forces, 2)
         where (ieee_is_finite(forces(:, a))) largest = max(largest, abs(forces(:, a)))
      end do
   end function largest

   !> Evaluates the forces of all samples and, if requested, their derivatives; sample by sample if the law fails for
   !> all of them together, so that only the samples for which it fails are lost.
   subroutine evaluate(law, samples, f, slopes)
      class(law_t), intent(in) :: law
      type(samples_t), intent(in) :: samples
      real(wp), intent(out), contiguous :: f(:, :)                    !! (n_samples, n_coordinates)
      real(wp), intent(out), contiguous, optional :: slopes(:, :, :, :)
         !! (n_samples, n_coordinates, n_coordinates, z v p)
      class(law_t), allocatable :: alone
      real(wp) :: f_one(1, size(f, 2)), slopes_one(1, size(f, 2), size(f, 2), 3)
      integer :: i

      if (present(slopes)) then
         call evaluate_block(law, samples%motion, f, slopes)
      else
         call evaluate_block(law, samples%motion, f)
      end if
      if (all(ieee_is_finite(f))) return
      allocate (alone, source=law)
      do i = 1, size(f, 1)
         if (law%n_phases > 0) call alone%set_phases(samples%phases(:, i:i))
         if (present(slopes)) then
            call evaluate_block(alone, samples%motion(i:i, :, :), f_one, slopes_one)
            slopes(i, :, :, :) = slopes_one(1, :, :, :)
         else
            call evaluate_block(alone, samples%motion(i:i, :, :), f_one)
         end if
         f(i, :) = f_one(1, :)
      end do
   end subroutine evaluate

   !> Evaluates all samples together, as `evaluate`.
   subroutine evaluate_block(law, motion, f, slopes)
      class(law_t), intent(in) :: law
      real(wp), intent(in) :: motion(:, :, :)                         !! as samples_t has it; of steps without `slopes`
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), optional :: slopes(:, :, :, :)
      real(wp), allocatable :: z(:, :), v(:, :), p(:, :), df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      integer :: n, n_p, n_v

      n = size(f, 2)
      if (size(motion, 3) > n_path_parts) then
         call evaluate_steps(law, motion(:, :n, :n_path_parts), motion(:, :law%n_states, n_path_parts + 1), f)
         return
      end if
      n_v = merge(n, 0, law%needs_velocity)
      n_p = merge(n, 0, law%is_multiplier)
      allocate (z, source=motion(:, :, 1))
      allocate (v, source=motion(:, :n_v, 2))
      allocate (p, source=motion(:, :n_p, 3))
      if (.not. present(slopes)) then
         call law%evaluate(z, v, p, f)
         return
      end if
      allocate (df_dz(size(f, 1), n, n), df_dv(size(f, 1), n, n_v), df_dp(size(f, 1), n, n_p))
      call law%evaluate(z, v, p, f, df_dz, df_dv, df_dp)
      slopes = 0.0_wp
      slopes(:, :, :, 1) = df_dz
      if (n_v > 0) slopes(:, :, :, 2) = df_dv
      if (n_p > 0) slopes(:, :, :, 3) = df_dp
   end subroutine evaluate_block

   !> Evaluates a law with memory at the end of steps.
   subroutine evaluate_steps(law, path, states, f)
      class(law_t), intent(in) :: law
      real(wp), intent(in), contiguous :: path(:, :, :), states(:, :) !! as `advance` has them
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp) :: states_after(size(states, 1), size(states, 2))

      f = 0.0_wp
      select type (law)
      class is (hysteretic_law_t)
         call law%advance(states, path, states_after)
         call law%force(path(:, :, path_part%at_end), states_after, f)
      end select
   end subroutine evaluate_steps
end module hb_law_check
