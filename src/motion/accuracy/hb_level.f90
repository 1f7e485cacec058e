!> A set of harmonics with its grid and a motion in it, and the choice of the next one: from the error estimate's
!> estimates of the tuples that the set lacks and of the effect of its grid on the motion. A set gains the important
!> tuples and loses the unimportant ones. Source: docs/why/accuracy.md.
module hb_level
   use hb_characteristic, only: samples_along_time
   use hb_contact_parts, only: contact_parts_t                        ! gfortran 12 cannot write the module without it
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_frequency_part, only: frequency_part_t                      ! likewise
   use hb_harmonics, only: coefficients_in, harmonics_t, new_box, new_harmonics
   use hb_kinds, only: wp
   use hb_law, only: has_memory
   use hb_law_measure, only: law_measure_t
   use hb_linear_part, only: linear_part_t                            ! likewise
   use hb_memory_estimate, only: check_memory, sizes_of
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_options, only: options_t
   use hb_point_budget, only: budget_of, point_budget_t
   use hb_reduced_base, only: grid_share
   use hb_structure, only: structure_t                                ! likewise
   use hb_system, only: measure_of, system_t
   use hb_thresholds, only: max_reliable_error, negligible_step, small_share
   use hb_torus, only: fast_size, samples_for
   use hb_tuple_choice, only: chosen_tuples, largest_indices, tuple_union_t
   implicit none
   private
   public :: apply_safety_factor, check_discretisation, choose_next, choose_smaller, coarsen, degree_of, distance, &
      estimate_of, estimate_of_motion, estimate_of_wanted, goal_share, is_rigid, join, level_of, level_t, loaded_tuples, &
      max_failures, min_goal, needed_samples, rigid_safety_factor, transferred, trim_for_neighbour, trim_set, without_motion

   integer, parameter :: max_failures = 3                            ! consecutive levels
   real(wp), parameter :: share_of_tail = 0.5_wp, share_of_grid = 0.3_wp ! of the error of a level
   real(wp), parameter :: goal_share = 0.6_wp                         ! of the tolerance: estimates were up to 1.6 times too small
   real(wp), parameter :: min_goal = 0.03_wp !! of the estimate: smallest goal for the error of the next level
   real(wp), parameter :: max_removable = 0.02_wp                     ! errors of first order that can be removed
   real(wp), parameter :: max_amplification = 5.0_wp                  ! of neglected tuples by the response to them
   real(wp), parameter :: max_growth = 1.8_wp                         ! of a set, or the orders of a box, from one level to the next
   real(wp), parameter :: min_growth = 1.1_wp                       ! of a set that is too small for the motion
   real(wp), parameter :: max_tail_ratio = 0.2_wp
   integer, parameter :: min_tuples_to_grow = 50                      ! tuples, above which this is examined
   real(wp), parameter :: rigid_safety_factor = 2.0_wp                !! with rigid laws: estimates were .34 to 2 times the error
   real(wp), parameter :: clearly_smaller = 0.8_wp                    ! set or grid, worth a change; a grid shrinks by no more
   real(wp), parameter :: max_refinement = 2.5_wp                     ! of a grid; multipliers were less accurate after 1.8
   real(wp), parameter :: max_check_ratio = 4.0_wp, min_check_ratio = 1.5_wp ! samples, where a level only checks the estimate of
                                                                      ! another
   real(wp), parameter :: aliasing_power = 2.4_wp ! power of the spacing of samples with which aliasing decreases
   real(wp), parameter :: min_density = 1.5_wp                      ! samples of a grid, relative to 2 N + 1

   !> A discretisation, and a motion in it.
   type, extends(discretisation_t) :: level_t
      real(wp), allocatable :: unknowns(:)                            !! coefficients at the laws' coordinates, then all base
                                                                      !! frequencies; not allocated: not known
   end type level_t

contains

   !> Chooses the next level, with the motion of this one as first guess; without a motion if nothing can be changed, the
   !> limits are reached, or the motion is exact: there is no next level then.
   subroutine choose_next(system, options, required, result, top, goal, n_failures, next)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, intent(in) :: required(:, :)                           !! tuples that remain in the set, (n_tones, any)
      type(motion_result_t), intent(in) :: result
      type(level_t), intent(in) :: top
      real(wp), intent(in) :: goal                                    !! for the estimated error
      integer, intent(in) :: n_failures                               !! of levels chosen from this one
      type(level_t), intent(out) :: next
      type(error_t), allocatable :: error
      real(wp) :: finer
      integer :: n_samples(top%harmonics%n_tones)
      logical :: is_possible

      if (.not. goal > 0.0_wp) return
      next%discretisation_t = top%discretisation_t
      if (options%accuracy%grows_set) &
         call choose_set(n_failures == max_failures - 1 .or. raised_by(result)*result%error_estimate%truncation >= &
                         merge(max_reliable_error, max_removable, n_failures == 0), next%harmonics)
      if (allocated(error)) return
      if (options%accuracy%refines_grid) then
         finer = 1.0_wp
         if (degree_of(system) == 0) finer = refinement_of(options, result, top, goal, n_failures)
         call choose_grid(system, options, result, next%harmonics, finer*top%torus%n_samples, n_samples, is_possible)
         if (.not. is_possible) return
         call next%torus%resample(n_samples)
      else if (any(next%torus%n_samples < 2*next%harmonics%highest + 1)) then
         return
      end if
      if (min(next%harmonics%n_harmonics, top%harmonics%n_harmonics) >= options%accuracy%max_harmonics .and. &
          result%error_estimate%truncation > result%error_estimate%aliasing) return ! other tuples, but not more
      if (next%harmonics%equal(top%harmonics) .and. all(next%torus%n_samples == top%torus%n_samples)) return
      next%unknowns = on_other_set(top, next%harmonics)
      if (allocated(result%error_estimate%first_order) .and. n_failures == 0 .and. .not. any(system%tones%is_unknown)) &
         call apply_first_order_correction(system, result, top, next)

   contains

      !> Chooses the set of the next level.
      subroutine choose_set(as_box, set)
         logical, intent(in) :: as_box !! the error estimate cannot report the tuples that the set lacks
         type(harmonics_t), intent(out) :: set
         type(harmonics_t) :: around
         real(wp), allocatable :: carried(:), neglected(:)
         real(wp) :: amplification, smallest, tail
         integer :: capacity
         logical, allocatable :: is_needed(:)
         integer :: h

         if (as_box) then
            call new_box(set, ceiling(max_growth*top%harmonics%highest), .false., error)
            if (allocated(error)) return
            if (set%n_harmonics <= options%accuracy%max_harmonics .and. has_all_of(set, top%harmonics)) return
         end if
         allocate (carried, source=shares_of(system, top))
         is_needed = [(is_needed_at(options, required, top%harmonics%tuples(:, h)), h=1, top%harmonics%n_harmonics)]
         if (allocated(result%error_estimate%neglected)) then
            around = result%error_estimate%around
            neglected = result%error_estimate%neglected
         else                                                            ! the tangent was not usable: one more in all directions
            call new_box(around, top%harmonics%highest + 1, .false., error)
            if (allocated(error)) return
            allocate (neglected(around%n_harmonics), source=goal)
         end if
         amplification = raised_by(result)*result%error_estimate%truncation/max(norm2(neglected), tiny(1.0_wp))
         amplification = max(1.0_wp, min(amplification, max_amplification))      ! by the tuples of the set
         tail = share_of_tail*goal/amplification
         capacity = min(options%accuracy%max_harmonics, int(max_growth*max(top%harmonics%n_harmonics, min_tuples_to_grow)))
         smallest = negligible_step*tail
         do while (tail > smallest) ! neglected tuples may appear small, yet have an effect
            call new_harmonics(set, chosen_tuples(top%harmonics, carried, around, neglected, is_needed, tail, capacity), error)
            if (allocated(error)) return
            if (raised_by(result)*result%error_estimate%truncation <= goal .or. &
                set%n_harmonics > min_growth*top%harmonics%n_harmonics) return
            tail = max_tail_ratio*tail
         end do
      end subroutine choose_set
   end subroutine choose_next

   !> Samples per tone of the next level, relative to those of this one, for laws that are not polynomials.
   pure real(wp) function refinement_of(options, result, top, goal, n_failures) result(finer)
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: result                     !! on `top`
      type(level_t), intent(in) :: top
      real(wp), intent(in) :: goal                                    !! for the estimated error, > 0
      integer, intent(in) :: n_failures                               !! of levels chosen from this one
      real(wp), parameter :: growth_per_failure = 1.3_wp

      finer = (raised_by(result)*result%error_estimate%aliasing/(share_of_grid*goal))**(1.0_wp/aliasing_power)
      finer = max(clearly_smaller, min(finer, max_refinement))
      if (estimate_of_wanted(result) <= goal_share*options%accuracy%tolerance) &
         finer = min(finer, affordable_growth(options, result)**(1.0_wp/top%harmonics%n_tones))
      finer = finer*growth_per_failure**n_failures
   end function refinement_of

   !> Chooses the grid of the next level: as many samples as wanted, within the limit and at least those that its set needs, which
   !> are exact for polynomials. It is not possible if these are more than the limit, unless the base of the level needs fewer and
   !> the motion is not accurate yet.
   subroutine choose_grid(system, options, result, set, wanted, n_samples, is_possible)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: result
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: wanted(:)                               !! (n_tones)
      integer, intent(out) :: n_samples(:)                            !! (n_tones)
      logical, intent(out) :: is_possible
      real(wp) :: share
      integer :: least(size(n_samples))

      least = needed_samples(set%highest, degree_of(system))
      n_samples = least
      if (degree_of(system) == 0) n_samples = max(least, fast_size(ceiling(wanted)))
      if (has_memory(system%laws) .and. .not. any(system%tones%is_unknown)) &
         n_samples = samples_along_time(n_samples, system%tones%omega)
      is_possible = .true.
      associate (limit => options%accuracy%max_samples)
         do while (product(real(n_samples, wp)) > limit)
            if (all(n_samples <= least)) then
               is_possible = estimate_of_wanted(result) > options%accuracy%tolerance
               if (.not. is_possible) return
               share = grid_share(system, options, set%tuples, n_samples)   ! in its own base the level may have fewer
               is_possible = share*product(real(n_samples, wp)) <= limit
               return
            end if
            n_samples = max(least, min(n_samples - 2, fast_size(floor(0.9_wp*n_samples))))
         end do
      end associate
   end subroutine choose_grid

   !> Samples of a level that only checks the estimate of a motion, relative to those of that motion: as many as the permitted work
   !> suffices for. From a known motion a sample takes half as much.
   pure real(wp) function affordable_growth(options, result) result(more)
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: result                     !! that is checked
      real(wp), parameter :: share = 0.5_wp
      type(point_budget_t) :: budget

      budget = budget_of(options, result)
      more = budget%margin%left()/max(share*budget%margin%spent, 1.0_wp)
      more = max(min_check_ratio, min(more, max_check_ratio))
   end function affordable_growth

   !> Removes first-order errors from the start on a level if they are small, whatever the estimate is.
   subroutine apply_first_order_correction(system, result, top, next)
      type(system_t), intent(in) :: system
      type(motion_result_t), intent(in) :: result                     !! on `top`
      type(level_t), intent(in) :: top
      type(level_t), intent(inout) :: next                            !! with the motion of `top`
      type(level_t) :: corrected

      corrected%harmonics = next%harmonics
      corrected%unknowns = transferred(result%error_estimate%around, next%harmonics, [result%error_estimate%first_order, &
                                       top%unknowns(size(top%unknowns) - top%harmonics%n_tones + 1:)], top%harmonics%n_tones)
      if (distance(next, corrected, measure_of(system), .false.) < max_removable) next%unknowns = corrected%unknowns
   end subroutine apply_first_order_correction

   pure logical function has_all_of(set, other)
      type(harmonics_t), intent(in) :: set, other
      integer :: h

      has_all_of = all([(set%index_of(other%tuples(:, h)) > 0, h=1, other%n_harmonics)])
   end function has_all_of

   !> Removes from a solved level what a neighbour can omit: tuples that together contribute a small share of the tolerance, and
   !> samples without which aliasing stays within its share of the tolerance.
   subroutine trim_for_neighbour(system, options, required, result, level)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, intent(in) :: required(:, :)                           !! tuples that remain in the set, (n_tones, any)
      type(motion_result_t), intent(in) :: result                     !! on the level
      type(level_t), intent(inout) :: level
      real(wp) :: allowed                                             ! error by aliasing
      real(wp) :: density                                             ! of samples, relative to the present one

      call trim_set(system, options, required, small_share, level)
      if (.not. options%accuracy%refines_grid) return
      density = 1.0_wp
      if (degree_of(system) == 0) then
         allowed = share_of_grid*goal_share*options%accuracy%tolerance
         density = min(1.0_wp, (raised_by(result)*result%error_estimate%aliasing/allowed)**(1.0_wp/aliasing_power))
      end if
      call level%torus%resample(min(level%torus%n_samples, max(needed_samples(level%harmonics%highest, degree_of(system)), &
                                                               fast_size(ceiling(density*level%torus%n_samples)))))
   end subroutine trim_for_neighbour

   !> Leaves of a level what is its motion to a few tolerances: a small set from which that of the next point grows. The grid is
   !> the coarsest one for that set.
   subroutine coarsen(system, options, required, level)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, intent(in) :: required(:, :)                           !! tuples that remain in the set, (n_tones, any)
      type(level_t), intent(inout) :: level
      real(wp), parameter :: max_excess_in_tolerances = 3.0_wp        ! tolerances

      call trim_set(system, options, required, max_excess_in_tolerances, level)
      if (options%accuracy%refines_grid) &
         call level%torus%resample(min(level%torus%n_samples, needed_samples(level%harmonics%highest, degree_of(system))))
   end subroutine coarsen

   !> Removes from a level the tuples that together contribute at most a share of the tolerance.
   subroutine trim_set(system, options, required, share, level)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, intent(in) :: required(:, :)                           !! tuples that remain in the set, (n_tones, any)
      real(wp), intent(in) :: share
      type(level_t), intent(inout) :: level
      type(level_t) :: trimmed
      type(error_t), allocatable :: error
      real(wp), allocatable :: amplitudes(:)
      integer, allocatable :: retained(:)
      integer :: h

      allocate (amplitudes, source=shares_of(system, level))
      do h = 1, level%harmonics%n_harmonics
         if (is_needed_at(options, required, level%harmonics%tuples(:, h))) amplitudes(h) = huge(1.0_wp)
      end do
      allocate (retained, source=largest_indices(amplitudes, share*options%accuracy%tolerance, size(amplitudes)))
      if (size(retained) == size(amplitudes)) return
      trimmed%discretisation_t = level%discretisation_t
      call new_harmonics(trimmed%harmonics, level%harmonics%tuples(:, retained), error)
      if (allocated(error)) return
      trimmed%unknowns = on_other_set(level, trimmed%harmonics)
      level = trimmed
   end subroutine trim_set

   !> Chooses a smaller set and a coarser grid for a motion that is far more accurate than requested; `is_smaller` is
   !> true if the saving is worth the change.
   subroutine choose_smaller(system, options, required, level, is_smaller)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, intent(in) :: required(:, :)                           !! tuples that remain in the set, (n_tones, any)
      type(level_t), intent(inout) :: level
      logical, intent(out) :: is_smaller
      integer, allocatable :: least(:), n_samples(:)
      integer :: n_harmonics

      n_harmonics = level%harmonics%n_harmonics
      allocate (n_samples, source=level%torus%n_samples)
      if (options%accuracy%grows_set) call trim_set(system, options, required, small_share, level)
      if (options%accuracy%refines_grid) then
         allocate (least, source=needed_samples(level%harmonics%highest, degree_of(system)))
         if (degree_of(system) == 0) least = max(least, fast_size(ceiling(clearly_smaller*n_samples)))
         call level%torus%resample(min(n_samples, least))
      end if
      is_smaller = level%harmonics%n_harmonics <= clearly_smaller*n_harmonics .or. &
                   product(real(level%torus%n_samples, wp)) <= clearly_smaller*product(real(n_samples, wp))
   end subroutine choose_smaller

   !> Adds all tuples of a set to a level; its motion is zero there. `is_new` is true if any were added.
   subroutine join(level, set, is_new)
      type(level_t), intent(inout) :: level
      type(harmonics_t), intent(in) :: set
      logical, intent(out) :: is_new
      type(tuple_union_t) :: union
      type(level_t) :: joined
      type(error_t), allocatable :: error

      is_new = .not. has_all_of(level%harmonics, set)
      if (.not. is_new) return
      call union%add(level%harmonics%tuples)
      call union%add(set%tuples)
      joined%discretisation_t = level%discretisation_t
      call new_harmonics(joined%harmonics, union%list(), error)
      is_new = .not. allocated(error)
      if (.not. is_new) return
      call joined%torus%resample(max(level%torus%n_samples, needed_samples(joined%harmonics%highest, 0)))
      joined%unknowns = on_other_set(level, joined%harmonics)
      level = joined
   end subroutine join

   !> Set and grid of a stored point; those of the model if it has none of its own.
   function level_of(discretisation, position) result(level)
      type(discretisation_t), intent(in) :: discretisation
      type(curve_position_t), intent(in), optional :: position
      type(level_t) :: level
      type(error_t), allocatable :: error

      level%discretisation_t = discretisation
      if (.not. present(position)) return
      if (allocated(position%tuples)) call new_harmonics(level%harmonics, position%tuples, error) ! there was a motion in it
      if (allocated(position%n_samples)) call level%torus%resample(position%n_samples)
   end function level_of

   !> Whether a set must contain a tuple: the mean value, the fundamentals, outputs, and what else is required.
   pure logical function is_needed_at(options, required, tuple) result(is_needed)
      type(options_t), intent(in) :: options
      integer, intent(in) :: required(:, :)
      integer, intent(in) :: tuple(:)
      integer :: h

      is_needed = sum(abs(tuple)) <= 1
      if (allocated(options%accuracy%outputs)) then
         do h = 1, size(options%accuracy%outputs)
            associate (output => options%accuracy%outputs(h))
               if (allocated(output%tuple)) is_needed = is_needed .or. all(output%tuple == tuple) .or. all(output%tuple == -tuple)
            end associate
         end do
      end if
      do h = 1, size(required, 2)
         is_needed = is_needed .or. all(required(:, h) == tuple) .or. all(required(:, h) == -tuple)
      end do
   end function is_needed_at

   !> Tuples with loads, which remain in the sets of a motion, (n_tones, any).
   pure function loaded_tuples(system) result(tuples)
      type(system_t), intent(in) :: system
      integer, allocatable :: tuples(:, :)

      tuples = system%load_spectrum%nonzero_tuples()
   end function loaded_tuples

   !> Its set and grid alone.
   pure function without_motion(level) result(bare)
      type(level_t), intent(in) :: level
      type(level_t) :: bare

      bare%discretisation_t = level%discretisation_t
   end function without_motion

   !> Fails if the grid does not suit the set, or a point would need more memory than there is.
   subroutine check_discretisation(system, discretisation, options, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error

      call discretisation%torus%check(discretisation%harmonics, error)
      if (.not. allocated(error)) call check_memory(sizes_of(system, discretisation, options), options%memory_limit, error)
   end subroutine check_discretisation

   !> Coefficients (n_coefficients, coordinates) of the motion of a level.
   pure function coefficients_of(level) result(u)
      type(level_t), intent(in) :: level
      real(wp), allocatable :: u(:, :)

      associate (n => level%harmonics%n_coefficients, n_all => size(level%unknowns) - level%harmonics%n_tones)
         u = reshape(level%unknowns(:n_all), [n, n_all/n])
      end associate
   end function coefficients_of

   !> Unknowns of the motion of a level in another set.
   pure function on_other_set(level, set) result(unknowns)
      type(level_t), intent(in) :: level
      type(harmonics_t), intent(in) :: set
      real(wp), allocatable :: unknowns(:)

      unknowns = transferred(level%harmonics, set, level%unknowns, level%harmonics%n_tones)
   end function on_other_set

   !> Transfers unknowns from one set to another; new tuples are zero.
   pure function transferred(from_set, to_set, x, n_further) result(moved)
      type(harmonics_t), intent(in) :: from_set, to_set
      real(wp), intent(in) :: x(:)                                    !! coefficients of all coordinates, and others
      integer, intent(in) :: n_further                                !! of the others
      real(wp), allocatable :: moved(:)

      associate (n => from_set%n_coefficients, n_all => size(x) - n_further)
         moved = [coefficients_in(to_set, from_set, reshape(x(:n_all), [n, n_all/n])), x(n_all + 1:)]
      end associate
   end function transferred

   !> Distance of the motions of two levels relative to the second, as errors are estimated; of their amplitudes if phases are free.
   pure real(wp) function distance(lower, upper, measure, has_free_phases)
      type(level_t), intent(in) :: lower, upper
      type(law_measure_t), intent(in) :: measure
      logical, intent(in) :: has_free_phases
      type(law_measure_t) :: of_upper
      type(level_t) :: moved
      real(wp), allocatable :: seen(:, :), there(:, :)

      of_upper = measure
      call of_upper%relate_to(coefficients_of(upper))
      moved%harmonics = upper%harmonics
      moved%unknowns = on_other_set(lower, upper%harmonics)
      allocate (there, source=of_upper%seen(coefficients_of(moved)))
      allocate (seen, source=of_upper%seen(coefficients_of(upper)))
      if (has_free_phases) then
         distance = norm2(upper%harmonics%norms(there) - upper%harmonics%norms(seen))
      else
         distance = norm2(there - seen)
      end if
      distance = distance/max(norm2(seen), tiny(1.0_wp))
   end function distance

   !> Amplitudes of the tuples of a level relative to its motion, as errors are estimated, (n_harmonics).
   function shares_of(system, level) result(shares)
      type(system_t), intent(in) :: system
      type(level_t), intent(in) :: level
      real(wp), allocatable :: shares(:)
      type(law_measure_t) :: measure

      measure = measure_of(system)
      call measure%relate_to(coefficients_of(level))
      shares = level%harmonics%norms(measure%seen(coefficients_of(level)))
      shares = shares/max(norm2(shares), tiny(1.0_wp))
   end function shares_of

   !> Estimated error of a motion, from its error estimate or from the level below.
   pure real(wp) function estimate_of(result)
      type(motion_result_t), intent(in) :: result

      estimate_of = max(estimate_of_motion(result), result%level_estimate)
   end function estimate_of

   !> Estimated error from the motion alone: the errors caused by its set and by its grid are independent.
   pure real(wp) function estimate_of_motion(result) result(estimate)
      type(motion_result_t), intent(in) :: result

      estimate = hypot(result%error_estimate%truncation, result%error_estimate%aliasing)
   end function estimate_of_motion

   !> Factor by which the level below increases the estimate of the error estimate.
   pure real(wp) function raised_by(result)
      type(motion_result_t), intent(in) :: result

      raised_by = max(1.0_wp, result%level_estimate/max(estimate_of_motion(result), tiny(1.0_wp)))
   end function raised_by

   !> Largest estimated error of the quantities to which the tolerance applies: the named outputs, otherwise the
   !> motion and its frequencies.
   pure real(wp) function estimate_of_wanted(result) result(estimate)
      type(motion_result_t), intent(in) :: result

      if (allocated(result%output_estimate)) then
         estimate = maxval(max(result%output_estimate, result%output_level_estimate))
         return
      end if
      estimate = estimate_of(result)
      associate (found => result%error_estimate)
         if (allocated(found%frequency_error) .and. allocated(result%frequency)) &
            estimate = max(estimate, maxval(found%frequency_error/result%frequency))
      end associate
   end function estimate_of_wanted

   !> Increases the estimated errors of a motion with rigid laws, which error estimates underestimate where walls are struck; the
   !> truncation estimate under rigid friction has its factor already.
   pure subroutine apply_safety_factor(system, result)
      type(system_t), intent(in) :: system
      type(motion_result_t), intent(inout) :: result

      if (.not. is_rigid(system)) return
      if (strikes_walls()) &
         result%level_estimate = min(1.0_wp, hypot(rigid_safety_factor*result%error_estimate%truncation, &
               result%error_estimate%aliasing))
      if (allocated(result%output_estimate)) result%output_level_estimate = min(1.0_wp, rigid_safety_factor*result%output_estimate)

   contains

      pure logical function strikes_walls()
         integer :: i

         strikes_walls = .false.
         do i = 1, size(system%laws)
            if (.not. system%laws(i)%law%is_multiplier .or. system%laws(i)%law%is_rigid_friction()) cycle
            strikes_walls = .not. allocated(result%error_estimate%peak_force)
            if (.not. strikes_walls) strikes_walls = result%error_estimate%peak_force(i) > 0.0_wp
            if (strikes_walls) return
         end do
      end function strikes_walls
   end subroutine apply_safety_factor

   !> Whether a law is rigid.
   pure logical function is_rigid(system)
      type(system_t), intent(in) :: system
      integer :: i

      is_rigid = any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))])
   end function is_rigid

   !> Degree of the laws if all are polynomials, otherwise 0.
   pure integer function degree_of(system) result(degree)
      type(system_t), intent(in) :: system
      integer :: i

      degree = 1
      do i = 1, size(system%laws)
         if (system%laws(i)%law%degree == 0) then
            degree = 0
            return
         end if
         degree = max(degree, system%laws(i)%law%degree)
      end do
   end function degree_of

   !> Smallest number of samples of each tone for the largest entries of a set: free of aliasing for polynomials,
   !> otherwise slightly more than required to separate its harmonics.
   pure function needed_samples(highest, degree) result(n_samples)
      integer, intent(in) :: highest(:)                               !! (n_tones)
      integer, intent(in) :: degree                                   !! of the laws, 0: no polynomials
      integer :: n_samples(size(highest))

      if (degree > 0) then
         n_samples = samples_for(highest, degree)
      else
         n_samples = max(8, fast_size(ceiling(min_density*(2*highest + 1))))
      end if
   end function needed_samples
end module hb_level
