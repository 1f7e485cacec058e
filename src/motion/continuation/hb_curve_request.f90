!> The request for a curve of motions: the value that moves, its range, what is located, and the point of another curve at which
!> it may begin.
module hb_curve_request
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t, fail
   use hb_harmonics, only: coefficients_in, harmonics_t, new_harmonics
   use hb_kinds, only: two_pi, wp
   use hb_level, only: degree_of, join, level_of, level_t, needed_samples
   use hb_located_response, only: located_response_t
   use hb_model_number, only: moving_value_t
   use hb_motion_result, only: curve_position_t
   use hb_options, only: options_t
   use hb_point_kinds, only: curve_kind
   use hb_system, only: system_t
   use hb_torus_multipliers, only: tone_of_maps
   use hb_tuple_choice, only: new_doubled_set
   implicit none
   private
   public :: curve_origin_t, curve_request_t, new_curve_origin, usual_points

   integer, parameter :: usual_points = 500                           !! of a curve, at most

   !> The point at which a curve of other motions leaves the one on which it was found (hb_curve_origin).
   type :: curve_origin_t
      logical :: is_torus = .false. !! there is an additional tone, the last one; otherwise the period doubles
      type(level_t) :: level                                          !! the wider set, and its grid
      real(wp), allocatable :: u(:, :)                                !! motion in the wider set, (n_coefficients, n_coordinates)
      real(wp), allocatable :: further(:)                             !! frequencies of unknown tones, and the value
      real(wp) :: angle = 0.0_wp                                      !! of the pair of multipliers, for an additional tone [rad]
   end type curve_origin_t

   !> A located point, such as a peak or fold along a first value, that is followed along a second one instead of the
   !> motion itself.
   type :: over_t
      integer :: kind = curve_kind%peak                               !! or another one
      type(moving_value_t) :: moving                                  !! the first value
      real(wp) :: from = 0.0_wp, to = 0.0_wp                          !! its range
   end type over_t

   !> The request.
   type :: curve_request_t
      type(moving_value_t) :: moving
      real(wp) :: from = 0.0_wp, to = 0.0_wp                          !! range of the value
      real(wp) :: start = 0.0_wp                                      !! value of the first motion, in the range
      real(wp), allocatable :: values(:)                              !! to be reached exactly
      real(wp), allocatable :: others(:)                              !! likewise; separate motions are searched for there
      real(wp) :: longest_step = 0.04_wp                              !! in units of the range and of the largest motion
      integer :: n_points = 0                                         !! at most
      logical :: switches = .false.                                   !! at branch points the other curve is followed as well
      logical :: jumps = .false.                                      !! where it folds back or is lost it goes on beyond
      type(located_response_t), allocatable :: responses(:)
      type(curve_origin_t), allocatable :: origin                     !! if given: the point at which the curve leaves another
                                                                      !! one, instead of a first motion at `start`
      type(over_t), allocatable :: over                               !! hb_motion_ridge
   end type curve_request_t

contains

   !> Transfers the motion of a point on another curve to the set of a model, or to one chosen around it if sets are
   !> chosen by a tolerance. Fails if it does not fit.
   subroutine new_curve_origin(self, is_torus, position, tuples, system, discretisation, options, error)
      type(curve_origin_t), intent(out) :: self
      logical, intent(in) :: is_torus                                 !! otherwise the period doubles
      type(curve_position_t), intent(in) :: position                  !! on the other curve
      integer, intent(in) :: tuples(:, :)                             !! on the other curve, (its tones, its harmonics)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation            !! with the wider set
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: other, same                                ! its tuples there, and among those of the model
      real(wp) :: first                                               ! base frequency of the original motion [rad/s]
      integer :: n, n_coordinates, n_further

      call new_harmonics(other, tuples, error)
      if (allocated(error)) return
      self%is_torus = is_torus
      n_further = 1 + count(system%tones%is_unknown) - merge(1, 0, is_torus)
      n = size(position%unknowns)
      n_coordinates = (n - n_further)/other%n_coefficients
      if (n_coordinates < 1 .or. n /= n_coordinates*other%n_coefficients + n_further .or. &
          discretisation%harmonics%n_tones /= other%n_tones + merge(1, 0, is_torus)) then
         call fail(error, "its motion does not fit the tones, harmonics and laws of this input")
         return
      end if
      call choose_level(self%level, other, is_torus, system, discretisation, options, error, position%n_samples)
      if (allocated(error)) return
      call new_harmonics(same, tuples_here(other%tuples, is_torus), error)
      if (allocated(error)) return
      allocate (self%u, source=coefficients_in(self%level%harmonics, same, &
                                               reshape(position%unknowns(:n - n_further), [other%n_coefficients, n_coordinates])))
      associate (found => position%unknowns(n - n_further + 1:n - 1), value => position%unknowns(n), angle => position%angle)
         if (is_torus) then
            self%angle = angle*ratio_to_first()
            first = system%tones%omega(1)
            if (system%tones%is_unknown(1)) first = found(1)
            self%further = [found, self%angle/two_pi*first, value]
         else
            self%further = [0.5_wp*found, value]
         end if
      end associate

   contains

      !> Frequency of the tone over whose period the multipliers are, relative to that of the first.
      pure real(wp) function ratio_to_first() result(ratio)
         real(wp) :: omega(other%n_tones)

         omega = system%tones%omega(:other%n_tones)
         omega = unpack(position%unknowns(n - n_further + 1:n - 1), system%tones%is_unknown(:other%n_tones), omega)
         ratio = omega(tone_of_maps(other%tuples))/omega(1)
      end function ratio_to_first
   end subroutine new_curve_origin

   !> Tuples of the motion there among those of the other motions: with another tone, or of half the frequency.
   pure function tuples_here(tuples, is_torus) result(here)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones there, n_harmonics)
      logical, intent(in) :: is_torus
      integer, allocatable :: here(:, :)                              !! (n_tones here, n_harmonics)
      integer :: h

      here = 2*tuples
      if (.not. is_torus) return
      here = reshape([(tuples(:, h), 0, h=1, size(tuples, 2))], [size(tuples, 1) + 1, size(tuples, 2)])
   end function tuples_here

   !> Set and grid of the other motions: those of the model or, with a tolerance, the tuples of the motion and the new
   !> ones next to them.
   subroutine choose_level(level, other, is_torus, system, discretisation, options, error, n_samples)
      type(level_t), intent(out) :: level
      type(harmonics_t), intent(in) :: other
      logical, intent(in) :: is_torus
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_samples(:)
      type(harmonics_t) :: wide
      integer, allocatable :: finer(:)
      logical :: is_new

      level = level_of(discretisation)
      if (options%accuracy%grows_set) then
         if (is_torus) then
            call new_harmonics(wide, tuples_here(other%tuples, is_torus), error)
         else
            call new_doubled_set(wide, other, error)
         end if
         if (allocated(error)) return
         level%unknowns = [spread(0.0_wp, 1, level%harmonics%n_coefficients), 0.0_wp*system%tones%omega]
         call join(level, wide, is_new)
         deallocate (level%unknowns)
         if (level%harmonics%n_harmonics > options%accuracy%max_harmonics) then
            call fail(error, "the other motions begin with more tuples than accuracy%max_harmonics allows")
            return
         end if
      end if
      if (.not. (options%accuracy%is_on .and. options%accuracy%refines_grid)) return
      call level%torus%resample(max(level%torus%n_samples, needed_samples(level%harmonics%highest, degree_of(system))))
      if (.not. present(n_samples)) return
      finer = level%torus%n_samples
      finer(:other%n_tones) = max(finer(:other%n_tones), merge(1, 2, is_torus)*n_samples)
      call level%torus%resample(finer)
   end subroutine choose_level
end module hb_curve_request
