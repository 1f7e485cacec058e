!> Curves that are followed for tests, and the Duffing oscillator of which most of them are.
module followed_curves
   use hb_curve_request, only: curve_request_t
   use hb_document, only: document_t, parameter_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_reader, only: read_model
   use hb_motion_curve, only: motion_curve_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_namelist, only: read_namelist
   use hb_outcome, only: outcome
   use hb_parameter_number, only: find_number
   use hb_response, only: new_response
   use model_texts, only: one_group_a_line
   implicit none
   private
   public :: add, between, duffing, first_of, follow_curve, followed_t, lower_fold, max_points, peak, upper_fold

   ! Folds by a bordered system with 40 harmonics, the peak by shooting and by a balance; one degree of freedom, 7 harmonics.
   character(*), parameter :: duffing = &
      "&structure type='chain' n_masses=1 ends='free' mass=1 coupling_stiffness=0 ground_stiffness=1 damping_mass=0.05 / "// &
      "&tones frequency=0.5 / &harmonics order=7 / &sampling samples=64 / &load dof='x1' tuple=1 cos=0.18 / "// &
      "&law type='cubic_spring' dof='x1' stiffness=0.1 /"
   real(wp), parameter :: upper_fold = 1.269601956_wp, lower_fold = 1.115700252_wp, peak = 1.26871674_wp
   real(wp), parameter :: between = 1.2_wp                            ! frequency with three motions
   integer, parameter :: max_points = 400

   !> A curve that was followed.
   type :: followed_t
      character(:), allocatable :: problem                            !! why it ended before; empty: nothing did
      integer :: n = 0
      type(curve_position_t) :: position(max_points)
      real(wp) :: amplitude(max_points) = 0.0_wp
      real(wp) :: frequency(max_points) = 0.0_wp, mean(max_points) = 0.0_wp
      integer :: status(max_points) = outcome%pending
      real(wp) :: estimate(max_points) = 0.0_wp
   end type followed_t

contains

   !> Follows a curve of the Duffing oscillator; a load moves at a frequency between the folds. With `break`, another one continues
   !> it after that point, with the same folds, peaks and branch points so far.
   subroutine follow_curve(request, path, followed, break, model_text)
      type(curve_request_t), intent(in) :: request
      character(*), intent(in) :: path
      type(followed_t), intent(out) :: followed
      integer, intent(in), optional :: break
      character(*), intent(in), optional :: model_text                !! instead of the Duffing oscillator
      class(motion_curve_t), allocatable, target :: curve, other
      type(curve_request_t), allocatable :: requested
      type(document_t), target :: document
      type(parameter_t) :: parameter
      type(error_t), allocatable :: error
      type(motion_result_t) :: result
      type(parameter_t) :: tone
      class(model_t), allocatable :: model
      character(:), allocatable :: text
      logical :: is_same

      followed%problem = ""
      allocate (curve, other, model)
      text = duffing
      if (present(model_text)) text = model_text
      call read_namelist(document, "test.nml", one_group_a_line(text), error)
      if (failed()) return
      call document%resolve("tones%frequency", tone, error)
      if (path /= "tones%frequency" .and. .not. present(model_text)) call document%set(tone, between)
      allocate (requested, source=request)                            ! by assignment gfortran 14 sees unset bounds
      call document%resolve(path, parameter, error)
      if (failed()) return
      requested%moving%typical = abs(requested%to - requested%from)
      if (requested%n_points == 0) requested%n_points = max_points
      call document%set(parameter, requested%start)
      call read_model(model, document, error)
      call find_number(document, parameter, requested%moving%number)
      if (failed()) return
      allocate (requested%responses(1))
      call new_response(requested%responses(1)%response_t, "x1 (1)", model%system%structure, 1, error)
      if (failed()) return
      call curve%begin(model, requested, result, error)
      call add(followed, result)
      do while (.not. curve%is_done)
         if (failed()) return
         if (present(break)) then
            if (followed%n == break) exit
         end if
         call curve%next(result, error)
         call add(followed, result)
      end do
      if (failed()) return
      call curve%destroy()
      if (.not. present(break)) return
      call other%continue_from(model, requested, followed%position(:break), error)
      if (failed()) return
      associate (seen => curve%course%reported, again => other%course%reported, origins => curve%branches%origins, &
                 restored => other%branches%origins)
         is_same = size(seen) == size(again) .and. size(origins) == size(restored)
         if (is_same) is_same = all(origins%is_apart .eqv. restored%is_apart) .and. &
                                abs(sum(seen%length) - sum(again%length)) <= 1.0e-12_wp
      end associate
      if (.not. is_same) followed%problem = "the folds, peaks or branch points so far differ"
      do while (.not. other%is_done)
         call other%next(result, error)
         call add(followed, result)
         if (failed()) return
      end do
      call other%destroy()

   contains

      logical function failed()
         failed = allocated(error)
         if (failed) followed%problem = error%message
      end function failed
   end subroutine follow_curve

   subroutine add(followed, result)
      type(followed_t), intent(inout) :: followed
      type(motion_result_t), intent(in) :: result

      followed%n = followed%n + 1
      followed%status(followed%n) = result%status
      if (.not. allocated(result%curve)) return                       ! no continuation was possible
      followed%position(followed%n) = result%curve
      followed%amplitude(followed%n) = norm2(result%coefficients(:, 2, 1))
      followed%frequency(followed%n) = result%frequency(1)
      followed%mean(followed%n) = result%coefficients(1, 1, 1)
      followed%estimate(followed%n) = result%error_estimate%truncation
   end subroutine add

   !> The first point of a kind after another point.
   pure integer function first_of(followed, kind, behind) result(point)
      type(followed_t), intent(in) :: followed
      integer, intent(in) :: kind, behind

      point = behind + findloc(followed%position(behind + 1:followed%n)%kind, kind, dim=1)
   end function first_of
end module followed_curves
