!> Marching from points of a result file: does the motion that the balance found stay where it is?
!>
!> The march starts on the motion of a point at time zero; its difference to that motion tells two things. What shows within
!> the first period of the slowest tone is an error of the motion. What grows from little is an instability: the motion is
!> right, and would not be seen. Tones that the balance has found may drift (hb_march_difference): as far as that is more than
!> the errors of the frequencies let expect, the motion is wrong.
module hb_verify
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file, open_file_parallel
   use hb_kinds, only: two_pi, wp
   use hb_march, only: march_from, march_record_t
   use hb_march_config, only: march_config_t, step_of
   use hb_march_difference, only: compare, march_difference_t, motion
   use hb_march_state, only: march_state_t, new_march_state
   use hb_march_system, only: march_system_t, new_march_system
   use hb_mpi, only: comm_t, rank_of, share_error, size_of
   use hb_namelist, only: document_t
   use hb_outcome, only: is_solved
   use hb_scene, only: scene_t
   use hb_scene_reader, only: read_scene
   use hb_study, only: new_study, study_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: verdict, verdict_text, verdict_t, verify_points

   integer, parameter :: periods_of_sliders = 20                      ! of the motion, in which sliders find their places
   real(wp), parameter :: safety = 10.0_wp                            ! on the estimates of the certificate
   real(wp), parameter :: smallest_tolerance = 1.0e-9_wp              ! relative to the motion
   real(wp), parameter :: march_tolerance = 1.0e-13_wp                ! of the march, unless the input asks for less
   real(wp), parameter :: grown = 30.0_wp                             ! difference of the last period over that of the first

   type :: verdict_kind_t
      integer :: not_done = 0
      integer :: agrees = 1
      integer :: unstable = 2
      integer :: differs = 3
   end type verdict_kind_t
   type(verdict_kind_t), parameter :: verdict = verdict_kind_t()

   !> What marching says of one point.
   type :: verdict_t
      integer :: kind = verdict%not_done
      integer :: skipped_status = 0                                   !! outcome of a point without a motion to start from
      real(wp) :: first_difference = 0.0_wp                           !! in the first period, relative to the largest motion
      real(wp) :: difference = 0.0_wp                                 !! over all, likewise
      real(wp) :: growth = 0.0_wp                                     !! of the difference [1/s]
      real(wp), allocatable :: drift(:)                               !! of the frequencies found [rad/s], (n_tones)
      real(wp) :: tolerance = 0.0_wp                                  !! what the certificate lets expect
   end type verdict_t

   !> What is read of a result file.
   type :: stored_t
      type(study_t) :: study
      integer, allocatable :: status(:)                               !! (n_points)
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      real(wp), allocatable :: frequency(:, :)                        !! (n_tones, n_points)
      real(wp), allocatable :: frequency_estimates(:, :)              !! as frequency
      real(wp), allocatable :: coefficients(:, :, :, :)               !! (2, n_harmonics, n_dofs, n_points)
      real(wp), allocatable :: estimates(:)                           !! of truncation and aliasing together, (n_points)
   end type stored_t

contains

   !> Verdict in words.
   pure function verdict_text(kind) result(text)
      integer, intent(in) :: kind
      character(:), allocatable :: text

      select case (kind)
      case (verdict%agrees); text = "agrees"
      case (verdict%unstable); text = "grows: the motion is unstable"
      case (verdict%differs); text = "differs by more than the certificate lets expect"
      case default; text = "not marched"
      end select
   end function verdict_text

   !> Marches from points of a result file and writes what comes out beside them. Ranks share the points.
   subroutine verify_points(path, points, n_periods, comm, verdicts, error)
      character(*), intent(in) :: path
      integer, intent(in) :: points(:)                                !! from 0; empty: all. Those not solved are skipped
      integer, intent(in) :: n_periods                                !! of the slowest tone
      type(comm_t), intent(in) :: comm
      type(verdict_t), allocatable, intent(out) :: verdicts(:)        !! (n_points), of the points of this rank
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(stored_t) :: stored
      type(h5_file_t) :: file
      integer :: i, n_done

      call read_stored(path, stored, error)
      if (.not. allocated(error)) call check_points(stored, points, error)
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
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: texts(:)
      integer, allocatable :: n(:)
      real(wp), allocatable :: aliasing(:)

      call open_file(file, path, error)
      if (allocated(error)) return
      call file%open_dataset("coefficients", dataset, error)
      if (.not. allocated(error)) then
         n = dataset%get_extents()
         allocate (stored%coefficients(n(1), n(2), n(3), n(4)), stored%status(n(4)), stored%estimates(n(4)), aliasing(n(4)))
         call dataset%read(stored%coefficients, error)
      end if
      if (.not. allocated(error)) call file%open_dataset("status", dataset, error)
      if (.not. allocated(error)) call dataset%read(stored%status, error)
      if (.not. allocated(error)) call file%open_dataset("truncation_estimate", dataset, error)
      if (.not. allocated(error)) call dataset%read(stored%estimates, error)
      if (.not. allocated(error)) call file%open_dataset("aliasing_estimate", dataset, error)
      if (.not. allocated(error)) call dataset%read(aliasing, error)
      if (.not. allocated(error)) stored%estimates = stored%estimates + aliasing
      if (.not. allocated(error)) call file%open_dataset("frequency", dataset, error)
      if (.not. allocated(error)) then
         n = dataset%get_extents()
         allocate (stored%frequency(n(1), n(2)), stored%frequency_estimates(n(1), n(2)))
         allocate (stored%tuples(n(1), size(stored%coefficients, 2)))
         call dataset%read(stored%frequency, error)
      end if
      if (.not. allocated(error)) call file%open_dataset("frequency_estimate", dataset, error)
      if (.not. allocated(error)) call dataset%read(stored%frequency_estimates, error)
      if (.not. allocated(error)) call file%open_dataset("tuple", dataset, error)
      if (.not. allocated(error)) call dataset%read(stored%tuples, error)
      if (.not. allocated(error)) call file%open_dataset("input_complete", dataset, error)
      if (.not. allocated(error)) call dataset%read(texts, error)
      call file%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      if (.not. allocated(error)) call new_study(stored%study, path//": input_complete", texts(1), [string_t ::], error)
   end subroutine read_stored

   !> Marches from one point.
   subroutine verify_point(stored, point, n_periods, result, error)
      type(stored_t), intent(in) :: stored
      integer, intent(in) :: point, n_periods
      type(verdict_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(march_config_t) :: config
      type(march_difference_t) :: difference
      type(march_record_t) :: record
      type(march_state_t) :: state
      type(march_system_t), target :: system
      type(scene_t) :: scene
      complex(wp), allocatable :: amplitudes(:, :)
      real(wp), allocatable :: frequencies(:), most_drift(:)
      real(wp) :: period, step

      document = stored%study%document
      call stored%study%plan%apply(point, document, error)
      if (.not. allocated(error)) call read_scene(scene, document, error)
      if (allocated(error)) return
      amplitudes = cmplx(stored%coefficients(1, :, :, point), -stored%coefficients(2, :, :, point), wp)
      where (stored%coefficients(1, :, :, point) /= stored%coefficients(1, :, :, point)) amplitudes = (0.0_wp, 0.0_wp)
      frequencies = matmul(stored%frequency(:, point), real(stored%tuples, wp))
      call new_march_system(system, scene%structure, scene%laws, scene%loads, &
                            scene%harmonics%frequencies(stored%frequency(:, point)), stored%frequency(:, point))
      call new_march_state(state, system%n_dofs, system%laws%n_states)
      period = two_pi/minval(stored%frequency(:, point))
      config = scene%march
      config%transient = 0.0_wp
      config%duration = n_periods*period
      config%decimation = 1
      config%tolerance = min(config%tolerance, march_tolerance)
      step = step_of(config, stored%frequency(:, point))
      call place_state(system, amplitudes(:, scene%output%dofs), scene%output%dofs, frequencies, -periods_of_sliders*period, step, &
                       state)
      call march_from(system, config, step, scene%output%dofs, state, record, error)
      if (allocated(error)) return
      result%tolerance = safety*scene%certificate%truncation
      if (ieee_is_finite(stored%estimates(point))) result%tolerance = safety*stored%estimates(point)
      result%tolerance = max(result%tolerance*velocity_share(amplitudes, frequencies), smallest_tolerance)
      call compare(difference, record, amplitudes, stored%tuples, stored%frequency(:, point), scene%tones%is_unknown, &
                   scene%structure%units(scene%output%dofs), result%tolerance)
      result%first_difference = difference%first
      result%difference = difference%largest
      result%growth = difference%growth
      result%drift = difference%drift
      most_drift = result%tolerance*stored%frequency(:, point)
      where (ieee_is_finite(stored%frequency_estimates(:, point))) &
         most_drift = max(most_drift, safety*stored%frequency_estimates(:, point))
      if (result%difference > smallest_tolerance .and. result%first_difference <= result%tolerance .and. &
          result%growth*config%duration > log(grown)) then            ! what drifts then is the motion that it goes to
         result%kind = verdict%unstable
      else if (any(abs(result%drift) > most_drift)) then
         result%kind = verdict%differs
      else if (result%difference <= result%tolerance) then
         result%kind = verdict%agrees
      else
         result%kind = verdict%differs
      end if
   end subroutine verify_point

   !> How much larger an error of the displacements is as one of the velocities: what is left out has frequencies beyond the
   !> highest one, and the velocity that the march lacks at its start makes a motion with the leading one.
   pure real(wp) function velocity_share(amplitudes, frequencies) result(share)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]
      real(wp) :: leading

      leading = abs(frequencies(maxloc(maxval(abs(amplitudes), dim=2)*merge(1.0_wp, 0.0_wp, abs(frequencies) > 0.0_wp), dim=1)))
      share = 1.0_wp
      if (leading > 0.0_wp) share = max(share, maxval(abs(frequencies))/leading)
   end function velocity_share

   !> Sets a state on the motion at time zero; sliders follow the motion from rest at an earlier time.
   subroutine place_state(system, amplitudes, dofs, frequencies, start, step, state)
      type(march_system_t), intent(inout) :: system
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      integer, intent(in) :: dofs(:)                                  !! whose columns these are
      real(wp), intent(in) :: frequencies(:), start, step             !! [rad/s], [s], [s]
      type(march_state_t), intent(inout) :: state
      integer :: i, n

      n = merge(ceiling(-start/step), 0, system%laws%n_states > 0)
      do i = -n, 0
         call system%laws%start_step((i - 1)*step, state%q, state%v, state%s)
         state%q(dofs) = motion(amplitudes, frequencies, i*step)
         state%v(dofs) = motion(amplitudes*spread(cmplx(0.0_wp, frequencies, wp), 2, size(amplitudes, 2)), frequencies, i*step)
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
      type(h5_dataset_t) :: difference, drift, first_difference, growth, kind
      integer :: i

      call file%open_dataset("march_first_difference", first_difference, error)
      if (.not. allocated(error)) call file%open_dataset("march_difference", difference, error)
      if (.not. allocated(error)) call file%open_dataset("march_growth", growth, error)
      if (.not. allocated(error)) call file%open_dataset("march_drift", drift, error)
      if (.not. allocated(error)) call file%open_dataset("march_verdict", kind, error)
      do i = 1, size(verdicts)
         if (allocated(error)) return
         if (verdicts(i)%kind == verdict%not_done) cycle
         call first_difference%write_row(i, [verdicts(i)%first_difference], error)
         if (.not. allocated(error)) call difference%write_row(i, [verdicts(i)%difference], error)
         if (.not. allocated(error)) call growth%write_row(i, [verdicts(i)%growth], error)
         if (.not. allocated(error)) call drift%write_row(i, verdicts(i)%drift, error)
         if (.not. allocated(error)) call kind%write_row(i, [verdicts(i)%kind], error)
      end do
   end subroutine write_verdicts
end module hb_verify
