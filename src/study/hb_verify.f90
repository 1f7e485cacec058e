!> Marching from points of a result file: does the motion that the balance found stay where it is?
!>
!> One march starts on the motion of a point at time zero, a second one very close to it. What the two say together is decided in
!> hb_march_verdict: they part where the motion is unstable, and then it is right and would not be seen; else they come together
!> as fast as the start is forgotten, and what then is left between march and motion is the error of the motion. Tones that the
!> balance has found may drift (hb_march_difference): as far as that is more than the errors of the frequencies let expect, the
!> motion is wrong. The march lasts until this is decided, at most as long as the decay of the linear structure takes, within a
!> bound of work.
module hb_verify
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_curve_table, only: note_curve_values
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file, open_file_parallel
   use hb_judge, only: settled_t
   use hb_kinds, only: two_pi, wp
   use hb_law_coordinates, only: law_dofs_of
   use hb_march, only: march_from, march_record_t
   use hb_march_config, only: march_config_t, march_method, step_of
   use hb_march_difference, only: march_difference_t, motion, new_march_difference, series_t
   use hb_march_state, only: march_state_t, new_march_state
   use hb_march_system, only: march_system_t, new_march_system
   use hb_march_verdict, only: decide, growth_of, limit_of, n_settled, verdict
   use hb_marched_motion, only: fastest_of, has_bounds_of, settle
   use hb_modes, only: slowest_decay
   use hb_mpi, only: comm_t, rank_of, share_error, size_of
   use hb_outcome, only: is_solved, outcome
   use hb_results_record, only: read_record, record_t
   use hb_row_checks, only: refuse_damaged_rows
   use hb_run_services, only: run_services
   use hb_scene, only: scene_t
   use hb_scene_reader, only: read_scene
   use hb_stored_rows, only: stored_file_t
   use hb_structure, only: max_dofs
   use hb_study, only: new_study, study_t
   use hb_text, only: string_t, to_text
   use hb_watch, only: watch_t
   implicit none
   private
   public :: verdict_t, verify_points

   integer, parameter :: periods_of_sliders = 20                      ! of the motion, in which sliders find their places
   integer, parameter :: fewest_periods = 20                          ! of the slowest tone; of several twice that, and two beats
   integer, parameter :: most_periods_of_beats = 100
   integer, parameter :: least_bound = 100, greatest_bound = 1000     ! periods at which a march ends without a decision, at least
                                                                      ! and at last
   integer, parameter :: longest_decay = 1000000                      ! periods; a slower one is none to be told from it
   integer, parameter :: usual_bound = 150                            ! where nothing in the structure decays
   integer, parameter :: most_samples = 400000                        ! of one march, beyond the fewest periods
   integer, parameter :: periods_at_once = 5
   real(wp), parameter :: enough_decay = 8.0_wp                       ! of the slowest mode, as a logarithm: the bound
   real(wp), parameter :: most_decay = 3.0_wp                         ! likewise: the start is forgotten
   real(wp), parameter :: march_tolerance = 1.0e-13_wp                ! of the march, unless the input asks for less
   real(wp), parameter :: remembered = 10.0_wp                        ! fall of the distance below which the start still counts
   real(wp), parameter :: nearness = 1.0e-6_wp                        ! of the second march at its start, relative to the motion
   real(wp), parameter :: too_far = 1.0e-4_wp, too_near = 1.0e-10_wp  ! distances at which it is brought back there
   real(wp), parameter :: runaway = 1.0e4_wp                          ! displacement relative to the motion
   integer, parameter :: fewest_steps = 1000                          ! of fixed steps in a period of the slowest tone, and in
   real(wp), parameter :: step_of_mode = 0.1_wp                       ! radians of the fastest mode: errors of 1e-6 in a period
   real(wp), parameter :: gone = 2.0_wp                               ! likewise, where the march breaks off

   !> What marching says of one point.
   type :: verdict_t
      integer :: kind = verdict%not_done
      integer :: skipped_status = 0                                   !! outcome of a point without a motion to start from
      real(wp) :: first_difference = 0.0_wp                           !! in the first period, relative: the worst coordinate
      real(wp) :: difference = 0.0_wp                                 !! in the last ones, of the coordinate worst for its limit
      real(wp) :: limit = 0.0_wp                                      !! of that difference
      character(:), allocatable :: coordinate                         !! its name
      real(wp) :: growth = 0.0_wp                                     !! of what is close to the motion [1/s]
      real(wp), allocatable :: drift(:)                               !! of the frequencies found [rad/s], (n_tones)
      real(wp) :: duration = 0.0_wp                                   !! of the march [s]
      integer :: n_periods = 0                                        !! of the slowest tone, likewise
   end type verdict_t

   !> How long a march is, in periods of the slowest tone.
   type :: length_t
      real(wp) :: period = 0.0_wp                                     !! [s]
      integer :: n_samples = 0                                        !! in a period
      integer :: fewest = 0, bound = 0                                !! periods
      integer :: most = 0                                             !! to which the bound is raised where nothing is decided
      integer :: decay = 0                                            !! in which the linear structure forgets; 0: it does not
   end type length_t

   !> What is read of a result file beside its record.
   type, extends(record_t) :: stored_t
      type(study_t) :: study
      real(wp), allocatable :: frequency_estimates(:, :)              !! [rad/s], as frequency
      real(wp), allocatable :: coefficients(:, :, :, :)               !! (2, n_harmonics, n_dofs, n_points)
      integer, allocatable :: own_tuples(:, :, :)                 !! (n_tones, n_harmonics, n_points), where points have their own
      integer, allocatable :: n_harmonics(:)                          !! of them (n_points)
      real(wp), allocatable :: estimates(:)                           !! of truncation and aliasing together, (n_points)
   end type stored_t

contains

   !> Marches from points of a result file and writes what comes out beside them. Ranks share the points.
   subroutine verify_points(path, points, n_periods, comm, verdicts, error)
      character(*), intent(in) :: path
      integer, intent(in) :: points(:)                                !! from 0; empty: all. Those not solved are skipped
      integer, intent(in) :: n_periods                                !! of the slowest tone, at most; 0: by the decay
      type(comm_t), intent(in) :: comm
      type(verdict_t), allocatable, intent(out) :: verdicts(:)        !! (n_points), of the points of this rank
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(stored_t) :: stored
      type(h5_file_t) :: file
      integer :: i, n_done

      call read_stored(path, stored, error)
      if (.not. allocated(error)) call check_points(stored, points, error)
      if (.not. allocated(error)) call refuse_damaged_rows(path, stored%status, points, error)
      call share_error(comm, error)
      if (allocated(error)) return
      allocate (verdicts(size(stored%status)))
      n_done = 0
      do i = 1, size(verdicts)
         if (size(points) > 0 .and. all(points /= i - 1)) cycle
         if (.not. is_solved(stored%status(i))) then
            if (rank_of(comm) == 0) verdicts(i)%skipped_status = stored%status(i)
            cycle
         end if
         n_done = n_done + 1
         if (modulo(n_done - 1, size_of(comm)) /= rank_of(comm)) cycle
         call verify_point(stored, i, n_periods, verdicts(i), error)
         call annotate(error, "point "//to_text(i - 1))
         if (allocated(error)) exit
      end do
      call share_error(comm, error)
      if (allocated(error)) return
      call open_file_parallel(file, path, comm, error)
      call share_error(comm, error)
      if (allocated(error)) return
      call write_verdicts(file, verdicts, error)
      call file%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      call share_error(comm, error)
   end subroutine verify_points

   subroutine check_points(stored, points, error)
      type(stored_t), intent(in) :: stored
      integer, intent(in) :: points(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (size(stored%coefficients, 3) /= stored%study%scene%structure%n_dofs) then
         call fail(error, "marching starts from all degrees of freedom, and the file has "// &
                   to_text(size(stored%coefficients, 3))//" of "//to_text(stored%study%scene%structure%n_dofs)// &
                   "; solve again without &output dofs")
         return
      end if
      do i = 1, size(points)
         if (points(i) < size(stored%status)) cycle
         call fail(error, "there is no point "//to_text(points(i))//"; the file has 0 to "//to_text(size(stored%status) - 1))
         return
      end do
   end subroutine check_points

   subroutine read_stored(path, stored, error)
      character(*), intent(in) :: path
      type(stored_t), intent(out) :: stored
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(stored_file_t) :: of_file
      character(:), allocatable :: folder

      call read_record(stored%record_t, path, error)
      if (allocated(error)) return
      stored%estimates = stored%truncation + stored%aliasing
      call open_file(of_file%file, path, error)
      if (allocated(error)) return
      call read_motions(of_file, stored, error)
      call of_file%file%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      folder = stored%input_folder                                    ! files that the input names are those of the run
      if (len(folder) == 0) folder = stored%input_name(:index(stored%input_name, "/", back=.true.))
      if (.not. allocated(error)) call new_study(stored%study, &
         folder//path(index(path, "/", back=.true.) + 1:)//": input_complete", stored%input_complete, [string_t ::], error)
      if (allocated(error)) return
      if (stored%study%libraries() /= stored%input_libraries) call fail(error, "'"//path// &
         "' was made with another model or another library of a law, which is needed to verify it"//new_line("a")// &
         "now:"//new_line("a")//stored%study%libraries()//new_line("a")//"in the file:"//new_line("a")//stored%input_libraries)
      if (.not. allocated(error)) call note_curve_values(path, stored%study%plan, error)
   end subroutine read_stored

   !> Coefficients and frequencies of all points.
   subroutine read_motions(self, stored, error)
      type(stored_file_t), intent(inout) :: self
      type(stored_t), intent(inout) :: stored
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: tuples(:)
      real(wp), allocatable :: coefficients(:), estimates(:)

      call self%list(error)
      call self%fetch("coefficients", coefficients, error)
      call self%fetch("frequency_estimate", estimates, error)
      if (allocated(error)) return
      associate (n_tones => size(stored%tuples, 1), n => size(stored%tuples, 2))
         stored%coefficients = reshape(coefficients, [2, n, size(stored%dofs), stored%n_points])
         stored%frequency_estimates = reshape(estimates, [n_tones, stored%n_points])
         if (.not. stored%has_own_tuples) return
         call self%fetch("tuples", tuples, error)
         call self%fetch("n_harmonics", stored%n_harmonics, error)
         if (allocated(error)) return
         stored%own_tuples = reshape(tuples, [n_tones, n, stored%n_points])
         stored%n_harmonics = max(1, min(stored%n_harmonics, n))
      end associate
   end subroutine read_motions

   !> Marches from one point.
   subroutine verify_point(stored, point, n_periods, result, error)
      type(stored_t), intent(in) :: stored
      integer, intent(in) :: point, n_periods
      type(verdict_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(march_config_t) :: config
      type(length_t) :: length
      type(march_difference_t) :: difference
      type(march_record_t) :: other_record, record
      type(march_state_t) :: other, state
      type(march_system_t), target :: system
      type(scene_t) :: scene
      complex(wp), allocatable :: amplitudes(:, :)
      integer, allocatable :: all_dofs(:), tuples(:, :)
      real(wp), allocatable :: distance(:), frequencies(:), ratio(:), scale(:), speed(:)
      real(wp) :: estimate, expected, moved_back, share, step
      integer :: i, n_new

      document = stored%study%document
      call stored%study%plan%apply(point, document)
      call read_scene(scene, document, error, services=run_services())
      if (allocated(error)) return
      associate (omega => stored%frequency(:, point))
         tuples = stored%tuples
         if (stored%has_own_tuples) tuples = stored%own_tuples(:, :stored%n_harmonics(point), point)
         allocate (amplitudes(size(tuples, 2), scene%structure%n_dofs))
         amplitudes(:, scene%output%dofs) = cmplx(stored%coefficients(1, :size(tuples, 2), :, point), &
                                                  -stored%coefficients(2, :size(tuples, 2), :, point), wp)
         where (.not. ieee_is_finite(real(amplitudes, wp))) amplitudes = (0.0_wp, 0.0_wp)
         frequencies = matmul(omega, real(tuples, wp))
         call scene%structure%refuse_large("marching", max_dofs, error)
         if (allocated(error)) return
         call new_march_system(system, scene%structure, scene%laws, scene%loads%whole(), scene%harmonics%frequencies(omega), omega)
         call choose_length(length, scene, omega, n_periods)
         step = length%period/length%n_samples
         all_dofs = [(i, i=1, system%n_dofs)]
         scale = sum(abs(amplitudes), dim=1)
         scale = [(maxval(scale, mask=scene%structure%units == scene%structure%units(i)), i=1, size(scale))]
         where (scale <= 0.0_wp) scale = max(system%length, nearness)
         speed = scale*max(leading_of(amplitudes, frequencies), minval(omega))
         config = scene%march
         config%transient = 0.0_wp
         config%decimation = 1
         config%tolerance = min(config%tolerance, march_tolerance)
         if (config%method == march_method%cvode .and. .not. has_bounds_of(scene)) then
            config%method = march_method%runge_kutta_4
            config%substeps = ceiling(max(step*fewest_steps/length%period, step*fastest_of(scene)/step_of_mode))
         end if
         config%largest = runaway*maxval(scale)
         call new_march_state(state, system%n_dofs, system%laws%n_states)
         call place_state(system, amplitudes, frequencies, -periods_of_sliders*length%period, step, state)
         if (any(stored%status(point) == [outcome%marched, outcome%several]) .and. .not. scene%accuracy%grows_set) then
            scene%march%tolerance = config%tolerance
            call verify_marched(scene, system, tuples, transpose(amplitudes), state, stored%aliasing(point), result, error)
            return
         end if
         other = state
         other%q = other%q + nearness*scale*directions(system%n_dofs, 0)
         other%v = other%v + nearness*speed*directions(system%n_dofs, system%n_dofs)
         call new_march_difference(difference, series_t(amplitudes, tuples, omega, scene%tones%is_unknown), system%laws%shape, &
                                   scene%structure%units, max(system%length, nearness), n_settled(length%most, length%fewest))
         estimate = scene%certificate%truncation
         if (ieee_is_finite(stored%estimates(point))) estimate = stored%estimates(point)
         share = velocity_share(amplitudes, frequencies)
         expected = estimate
         moved_back = 0.0_wp
         allocate (distance(0))
         do while (result%kind == verdict%not_done)
            n_new = min(max(periods_at_once, difference%n_periods/4), length%bound - difference%n_periods)
            config%duration = n_new*length%period
            call march_from(system, config, step, all_dofs, state, record, error)
            if (.not. allocated(error)) call march_from(system, config, step, all_dofs, other, other_record, error)
            if (allocated(error)) then
               if (.not. has_run_away()) return
               deallocate (error)
               result%kind = verdict%differs
               if (size(distance) > 0) result%kind = decide([ratio, 2.0_wp], [distance, distance(size(distance))], &
                                                            length%fewest, length%decay, .true.)
               exit
            end if
            call difference%add(record, other_record, n_new)
            distance = [distance, log(max(difference%apart(size(distance) + 1:)/nearness, tiny(1.0_wp))) + moved_back]
            expected = estimate*merge(share, 1.0_wp, distance(size(distance)) > -log(remembered))
            ratio = [(maxval(difference%largest(:, i)/limit_of(expected, difference%share)), i=1, difference%n_periods)]
            call bring_back(state, other, scale, speed, moved_back)
            result%kind = decide(ratio, distance, length%fewest, length%decay, difference%n_periods >= length%bound)
            if (result%kind /= verdict%undecided .or. length%bound >= length%most) cycle
            length%bound = min(2*length%bound, length%most)
            result%kind = verdict%not_done
         end do
         call write_up()
      end associate

   contains

      !> Whether a march that broke off was on its way to infinity.
      logical function has_run_away()
         has_run_away = record%is_under_way
         if (.not. has_run_away) return
         associate (q => state%q, q_other => other%q)
            if (all(ieee_is_finite(q)) .and. all(ieee_is_finite(q_other))) &
               has_run_away = any(max(abs(q), abs(q_other)) > gone*scale)
         end associate
      end function has_run_away

      !> Fills the result in.
      subroutine write_up()
         real(wp), allocatable :: most_drift(:)
         integer :: n_kept

         result%n_periods = difference%n_periods
         result%duration = difference%n_periods*length%period
         result%drift = 0.0_wp*stored%frequency(:, point)
         result%coordinate = ""
         if (difference%n_periods == 0) return
         call find_worst(difference, system, length, expected, result)
         result%first_difference = maxval(difference%largest(:, 1))
         result%growth = growth_of(ratio, distance)/length%period
         n_kept = findloc(ratio > 1.0_wp, .true., dim=1) - 1
         if (n_kept < 0) n_kept = difference%n_periods
         result%drift = difference%drift(n_kept)
         if (result%kind == verdict%unstable) return                  ! what drifts then is the motion that it goes to
         most_drift = limit_of(estimate*share, 1.0_wp)*stored%frequency(:, point)
         where (ieee_is_finite(stored%frequency_estimates(:, point))) most_drift = max(most_drift, &
            limit_of(stored%frequency_estimates(:, point)/stored%frequency(:, point), 1.0_wp)*stored%frequency(:, point))
         if (any(abs(result%drift) > most_drift)) result%kind = verdict%differs
         if (result%kind == verdict%agrees .and. result%difference > result%limit) result%kind = verdict%differs
      end subroutine write_up
   end subroutine verify_point

   !> Verdict on a motion that was marched: another march, from the motion itself and with its own tolerance, until it is
   !> steady. What the set cannot hold of the motion is not part of its coefficients, so that these are compared.
   subroutine verify_marched(scene, system, tuples, amplitudes, start, spread, result, error)
      type(scene_t), intent(in) :: scene
      type(march_system_t), intent(in) :: system
      integer, intent(in) :: tuples(:, :)                             !! of the file, (n_tones, n_harmonics); a point may have fewer
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin [m], (n_dofs, n_harmonics)
      type(march_state_t), intent(in) :: start
      real(wp), intent(in) :: spread                                  !! of the averages, relative
      type(verdict_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: items(:, :), others(:, :)
      character(64), allocatable :: labels(:)
      real(wp), allocatable :: difference(:), scale(:)
      type(settled_t) :: settled
      type(watch_t), target :: watch
      integer :: i, k

      call settle(scene, law_dofs_of(scene%laws), watch, settled, error, start)
      if (allocated(error)) return
      result%n_periods = settled%n_periods
      result%duration = settled%n_periods*two_pi/minval(scene%tones%omega)
      result%drift = 0.0_wp*scene%tones%omega
      result%coordinate = ""
      result%kind = verdict%differs
      if (settled%status == outcome%pending) result%kind = verdict%undecided
      if (settled%status /= outcome%marched) return
      associate (n => scene%structure%n_dofs, shape => cmplx(system%laws%shape, 0.0_wp, wp), units => scene%structure%units)
         allocate (items(n + size(shape, 2), size(amplitudes, 2)), others(n + size(shape, 2), size(amplitudes, 2)))
         items(:n, :) = amplitudes
         items(n + 1:, :) = matmul(transpose(shape), amplitudes)
         others = (0.0_wp, 0.0_wp)
         do i = 1, size(tuples, 2)
            k = scene%harmonics%index_of(tuples(:, i))
            if (k > 0) others(:n, i) = settled%amplitudes(:, k)
         end do
         others(n + 1:, :) = matmul(transpose(shape), others(:n, :))
         scale = norm2(abs(items), dim=2)
         scale(:n) = [(maxval(scale(:n), mask=units == units(i)), i=1, n)]
      end associate
      difference = norm2(abs(others - items), dim=2)/max(scale, tiny(1.0_wp))
      labels = [character(64) :: scene%structure%labels, system%laws%coordinate_labels()]
      i = maxloc(difference, dim=1)
      result%coordinate = trim(labels(i))
      result%difference = difference(i)
      result%first_difference = difference(i)
      result%limit = limit_of(spread + settled%spread, 1.0_wp)
      if (result%difference <= result%limit) result%kind = verdict%agrees
   end subroutine verify_marched

   !> Length of the march from a motion: at least until all of it was seen, at most until the slowest mode of the linear structure
   !> is forgotten, as far as the bound of work allows.
   subroutine choose_length(self, scene, omega, n_periods)
      type(length_t), intent(out) :: self
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      integer, intent(in) :: n_periods                                !! at most; 0: not given
      real(wp) :: beat, rate
      integer :: i, k

      self%period = two_pi/minval(omega)
      self%n_samples = ceiling(self%period/step_of(scene%march, omega)*(1.0_wp - 1.0e-9_wp))
      beat = minval(omega)
      do i = 1, size(omega)
         do k = 1, i - 1
            if (abs(omega(i) - omega(k)) > 0.0_wp) beat = min(beat, abs(omega(i) - omega(k)))
         end do
      end do
      self%fewest = max(merge(2, 1, size(omega) > 1)*fewest_periods, min(most_periods_of_beats, ceiling(2.0_wp*minval(omega)/beat)))
      rate = 0.0_wp
      if (.not. allocated(scene%structure%sparse)) &
         rate = slowest_decay(scene%structure%mass, scene%structure%damping, scene%structure%stiffness)*self%period
      self%bound = usual_bound
      if (rate > 0.0_wp) then
         self%decay = ceiling(min(most_decay/rate, real(longest_decay, wp)))
         self%bound = max(least_bound, ceiling(min(enough_decay/rate, real(greatest_bound, wp))))
      end if
      self%most = max(self%fewest, min(greatest_bound, most_samples/self%n_samples))
      self%bound = max(self%fewest, min(self%bound, self%most))
      if (n_periods == 0) return
      self%bound = n_periods
      self%most = n_periods
   end subroutine choose_length

   !> Components between 1/2 and 1 of either sign, in no order that a structure would have.
   pure function directions(n, offset) result(values)
      integer, intent(in) :: n, offset
      real(wp) :: values(n)
      real(wp), parameter :: golden = 0.6180339887498949_wp, root = 0.4142135623730951_wp
      integer :: i

      values = [(merge(-1.0_wp, 1.0_wp, modulo((offset + i)*golden, 1.0_wp) < 0.5_wp)* &
                 (0.5_wp + 0.5_wp*modulo((offset + i)*root, 1.0_wp)), i=1, n)]
   end function directions

   !> Brings the second march back to the distance at which it began, in the same direction, where it is too far or too near.
   subroutine bring_back(state, other, scale, speed, moved_back)
      type(march_state_t), intent(in) :: state
      type(march_state_t), intent(inout) :: other
      real(wp), intent(in) :: scale(:), speed(:)                      !! [m], [m/s], (n_dofs)
      real(wp), intent(inout) :: moved_back                           !! logarithm of all that it was brought back by
      real(wp) :: apart

      apart = max(maxval(abs(other%q - state%q)/scale), maxval(abs(other%v - state%v)/speed))
      if (apart <= too_far .and. (apart >= too_near .or. apart <= epsilon(1.0_wp))) return
      other%q = state%q + nearness/apart*(other%q - state%q)
      other%v = state%v + nearness/apart*(other%v - state%v)
      other%s = state%s + nearness/apart*(other%s - state%s)
      moved_back = moved_back + log(apart/nearness)
   end subroutine bring_back

   !> The coordinate, or the tone of a coordinate, that is worst for its limit in the last periods.
   subroutine find_worst(difference, system, length, estimate, result)
      type(march_difference_t), intent(in) :: difference
      type(march_system_t), intent(in) :: system
      type(length_t), intent(in) :: length
      real(wp), intent(in) :: estimate
      type(verdict_t), intent(inout) :: result
      real(wp), allocatable :: differences(:, :), settled(:), shares(:, :)
      character(64), allocatable :: labels(:)
      integer :: c, i, m, n

      n = difference%n_periods
      settled = maxval(difference%largest(:, n - n_settled(n, length%fewest) + 1:), dim=2)
      i = maxloc(settled/limit_of(estimate, difference%share), dim=1)
      result%difference = settled(i)
      result%limit = limit_of(estimate, difference%share(i))
      labels = [character(64) :: system%structure%labels, system%laws%coordinate_labels()]
      result%coordinate = trim(labels(i))
      if (n < length%fewest) return                                   ! tones do not part in so short a time
      call difference%parts(differences, shares)
      do m = 1, size(differences, 2)
         do c = 1, size(differences, 1)
            if (differences(c, m)/limit_of(estimate, shares(c, m)) <= result%difference/result%limit) cycle
            result%difference = differences(c, m)
            result%limit = limit_of(estimate, shares(c, m))
            result%coordinate = trim(labels(difference%n_dofs + c))//", tone "//to_text(m)
         end do
      end do
   end subroutine find_worst

   !> How much larger an error of the displacements is as one of the velocities: what is left out has frequencies beyond the
   !> highest one, and the velocity that the march lacks at its start makes a motion with the leading one, until it decays.
   pure real(wp) function velocity_share(amplitudes, frequencies) result(share)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]
      real(wp) :: leading

      leading = leading_of(amplitudes, frequencies)
      share = 1.0_wp
      if (leading > 0.0_wp) share = max(share, maxval(abs(frequencies))/leading)
   end function velocity_share

   !> Frequency of the harmonic that moves most [rad/s].
   pure real(wp) function leading_of(amplitudes, frequencies)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]

      leading_of = abs(frequencies(maxloc(maxval(abs(amplitudes), dim=2)*merge(1.0_wp, 0.0_wp, abs(frequencies) > 0.0_wp), dim=1)))
   end function leading_of

   !> Sets a state on the motion at time zero; sliders follow the motion from rest at an earlier time.
   subroutine place_state(system, amplitudes, frequencies, start, step, state)
      type(march_system_t), intent(inout) :: system
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:), start, step             !! [rad/s], [s], [s]
      type(march_state_t), intent(inout) :: state
      integer :: i, n

      n = merge(ceiling(-start/step), 0, system%laws%n_states > 0)
      do i = -n, 0
         call system%laws%start_step((i - 1)*step, state%q, state%v, state%s)
         state%q = motion(amplitudes, frequencies, i*step)
         state%v = motion(amplitudes*spread(cmplx(0.0_wp, frequencies, wp), 2, size(amplitudes, 2)), frequencies, i*step)
         if (n == 0) cycle
         call system%laws%gather(state%q, state%v)
         call system%laws%evaluate(step)
         state%s = system%laws%s
      end do
   end subroutine place_state

   subroutine write_verdicts(file, verdicts, error)
      type(h5_file_t), intent(in) :: file
      type(verdict_t), intent(in) :: verdicts(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      integer :: i

      call write_column("march_first_difference", verdicts%first_difference)
      call write_column("march_difference", verdicts%difference)
      call write_column("march_limit", verdicts%limit)
      call write_column("march_growth", verdicts%growth)
      call write_column("march_duration", verdicts%duration)
      if (.not. allocated(error)) call file%open_dataset("march_drift", dataset, error)
      do i = 1, size(verdicts)
         if (verdicts(i)%kind /= verdict%not_done .and. .not. allocated(error)) call dataset%write(verdicts(i)%drift, error, i)
      end do
      call write_column("march_verdict", real(verdicts%kind, wp))

   contains

      subroutine write_column(name, values)
         character(*), intent(in) :: name
         real(wp), intent(in) :: values(:)
         integer :: k

         if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
         do k = 1, size(values)
            if (verdicts(k)%kind /= verdict%not_done .and. .not. allocated(error)) call dataset%write(values(k), error, k)
         end do
      end subroutine write_column
   end subroutine write_verdicts
end module hb_verify
