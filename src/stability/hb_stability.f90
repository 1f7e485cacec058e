!> Whether a motion will be seen: what becomes of a small disturbance of it.
!>
!> One tone: Floquet multipliers, the eigenvalues of what a period makes of a disturbance; the motion is stable where all are
!> smaller than 1 in magnitude. Several tones: Lyapunov exponents, stable where all are negative. What shifts a phase of the
!> motion's own has the multiplier 1 or the exponent 0 and is left out. Source: docs/user/theory.md, section 8.
module hb_stability
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t
   use hb_exponents, only: exponents_t, find_exponents, work_of_exponents
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: two_pi, wp
   use hb_koopman_hill, only: hill_t, new_hill
   use hb_law, only: law_box_t
   use hb_march_system, only: march_system_t
   use hb_monodromy, only: find_monodromy, monodromy_t, work_of_transfer
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_multipliers, only: deflate, eigenvalues_of
   use hb_period_map, only: find_period_map, new_period_map, period_map_t, work_of_period_map
   use hb_structure, only: most_dense, structure_t
   use hb_tones, only: tones_t
   use hb_variation, only: new_variation, variation_t
   implicit none
   private
   public :: find_marched_stability, find_stability, has_to_be_marched, n_multipliers_of, stability_config_t, stability_method
   public :: stability_method_names, stability_t, verdict

   integer, parameter :: most_multipliers = 16                        !! that are kept, the largest
   real(wp), parameter :: smallest_margin = 1.0e-9_wp                 ! of a multiplier from 1 that is sure
   real(wp), parameter :: safety = 10.0_wp                            ! on the estimate of the error
   real(wp), parameter :: safety_of_spread = 3.0_wp                   ! on the difference of both halves of a record
   real(wp), parameter :: work_on_demand = 6.0e10_wp                  ! in about a nanosecond: a minute

   type :: stability_method_t
      integer :: off = 0
      integer :: auto = 1
      integer :: hill = 2
      integer :: march = 3
   end type stability_method_t
   type(stability_method_t), parameter :: stability_method = stability_method_t()
   character(5), parameter :: stability_method_names(0:3) = [character(5) :: "off", "auto", "hill", "march"]

   type :: verdict_t
      integer :: unstable = -1
      integer :: unknown = 0
      integer :: stable = 1
   end type verdict_t
   type(verdict_t), parameter :: verdict = verdict_t()

   type :: stability_config_t
      integer :: method = stability_method%auto
      real(wp) :: patience = 1.0_wp                                   !! of `auto`: work that it may take, in usual points
      real(wp) :: tolerance = 1.0e-6_wp                               !! of the monodromy matrix, relative
   end type stability_config_t

   type :: stability_t
      integer :: verdict = verdict%unknown
      integer :: n_unstable = 0                                       !! multipliers outside of the unit circle, or exponents > 0
      integer :: method = stability_method%off                        !! that was used
      real(wp) :: estimate = 0.0_wp                                   !! of the error of the monodromy matrix, relative, of what it
                                                                      !! makes of a shift of the motion's own phase, or of the
                                                                      !! largest multiplier by that of the motion; of several
                                                                      !! tones the spread of the largest exponent [1/s]
      complex(wp), allocatable :: multipliers(:)                      !! of one tone, the largest first
      real(wp), allocatable :: exponents(:)                           !! [1/s], the largest first; of one tone growth rates
   contains
      procedure :: hold_against => stability_hold_against
   end type stability_t

contains

   !> Number of multipliers that are kept for a structure.
   pure integer function n_multipliers_of(n_dofs)
      integer, intent(in) :: n_dofs

      n_multipliers_of = min(2*n_dofs, most_multipliers)
   end function n_multipliers_of

   !> Compares with what was found along a better motion: a verdict on which both do not agree, or which lies within twice the
   !> change of the largest multiplier, is not known.
   pure subroutine stability_hold_against(self, better)
      class(stability_t), intent(inout) :: self
      type(stability_t), intent(in) :: better

      if (.not. (allocated(self%multipliers) .and. allocated(better%multipliers))) then
         self%verdict = verdict%unknown
         return
      end if
      associate (here => abs(self%multipliers(1)), there => abs(better%multipliers(1)))
         self%estimate = max(self%estimate, abs(here - there))
         if (self%verdict /= better%verdict) self%verdict = verdict%unknown
         if (self%verdict == verdict%stable .and. max(here, there) >= 1.0_wp - 2.0_wp*abs(here - there)) &
            self%verdict = verdict%unknown
      end associate
   end subroutine stability_hold_against

   !> Finds out whether a motion is stable; `auto` does so where it takes no more work than allowed. What cannot be told
   !> stays unknown.
   subroutine find_stability(self, config, structure, laws, tuples, tones, amplitudes, work_allowed)
      type(stability_t), intent(out) :: self
      type(stability_config_t), intent(in) :: config
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      type(tones_t), intent(in) :: tones                              !! of the motion
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_dofs, n_harmonics)
      real(wp), intent(in) :: work_allowed                            !! in about a nanosecond
      type(variation_t) :: variation
      type(hill_t), allocatable :: hill
      type(error_t), allocatable :: error
      real(wp) :: work

      if (config%method == stability_method%off) return
      call new_variation(variation, structure, laws, tuples, tones%omega, amplitudes, error)
      if (allocated(error)) return
      work = work_of_exponents(variation)
      if (tones%n_tones == 1) work = work_of_transfer(variation, two_pi/tones%omega(1))
      if (config%method == stability_method%auto .and. work > config%patience*work_allowed) return
      self%method = stability_method%march
      if (config%method == stability_method%hill .and. variation%is_smooth()) then
         allocate (hill)
         call new_hill(hill, variation, error)
         if (allocated(error)) return
         self%method = stability_method%hill
      end if
      if (tones%n_tones == 1) then
         call judge_period(self, config, variation, amplitudes, tones%is_unknown(1), hill)
      else
         call judge_torus(self, config, variation, amplitudes, tones%is_unknown, max(work, work_allowed), hill)
      end if
   end subroutine find_stability

   !> Disturbances by shifts of the phases of unknown tones, as series, (size of the state, n_harmonics, any).
   pure function shifts_of(variation, amplitudes, is_unknown) result(shifts)
      type(variation_t), intent(in) :: variation
      complex(wp), intent(in) :: amplitudes(:, :)
      logical, intent(in) :: is_unknown(:)
      complex(wp), allocatable :: shifts(:, :, :)
      complex(wp), parameter :: i = (0.0_wp, 1.0_wp)
      integer :: h, k, m, n

      n = size(amplitudes, 1)
      allocate (shifts(variation%size, size(amplitudes, 2), count(is_unknown)), source=(0.0_wp, 0.0_wp))
      k = 0
      do m = 1, size(is_unknown)
         if (.not. is_unknown(m)) cycle
         k = k + 1
         do h = 1, size(amplitudes, 2)
            shifts(:n, h, k) = i*variation%motion%tuples(m, h)*amplitudes(:, h)
            shifts(n + 1:2*n, h, k) = i*variation%motion%frequencies(h)/variation%scale*shifts(:n, h, k)
         end do
      end do
   end function shifts_of

   !> Exponents of a motion of several tones.
   subroutine judge_torus(self, config, variation, amplitudes, is_unknown, work_limit, hill)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout) :: variation
      complex(wp), intent(in) :: amplitudes(:, :)
      logical, intent(in) :: is_unknown(:)
      real(wp), intent(in) :: work_limit
      type(hill_t), allocatable, intent(inout) :: hill
      type(exponents_t) :: found
      real(wp) :: margin

      call find_exponents(found, variation, shifts_of(variation, amplitudes, is_unknown), config%tolerance, work_limit, hill)
      if (.not. allocated(found%rate)) return
      self%exponents = found%rate(:min(size(found%rate), most_multipliers))
      self%estimate = found%spread(1)
      margin = max(safety_of_spread*found%spread(1), smallest_margin*minval(abs(variation%motion%omega)))
      self%n_unstable = count(found%rate > safety_of_spread*found%spread .and. found%rate > margin)
      if (self%n_unstable > 0) then
         self%verdict = verdict%unstable
      else if (maxval(found%rate) < -margin) then
         self%verdict = verdict%stable
      end if
   end subroutine judge_torus

   !> Multipliers of a periodic motion.
   subroutine judge_period(self, config, variation, amplitudes, is_free, hill)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout) :: variation
      complex(wp), intent(in) :: amplitudes(:, :)
      logical, intent(in) :: is_free                                  !! the tone is the motion's own
      type(hill_t), allocatable, intent(inout) :: hill
      type(monodromy_t) :: monodromy
      complex(wp), allocatable :: shifts(:, :, :)
      real(wp), allocatable :: shift(:)

      associate (period => two_pi/variation%motion%omega(1))
         if (allocated(hill)) then
            call hill%transfer(0.0_wp, period, config%tolerance, monodromy%matrix, monodromy%estimate)
         else
            call find_monodromy(monodromy, variation, 0.0_wp, config%tolerance, work_on_demand)
         end if
      end associate
      self%estimate = monodromy%estimate
      if (.not. all(ieee_is_finite(monodromy%matrix))) return
      if (is_free) then
         shifts = shifts_of(variation, amplitudes, [.true.])
         shift = real(sum(shifts(:size(monodromy%matrix, 1), :, 1), dim=2))
         if (variation%n_states > 0) shift = matmul(monodromy%matrix, shift)   ! sliders join
         self%estimate = max(self%estimate, norm2(matmul(monodromy%matrix, shift) - shift)/norm2(shift))
         call deflate(monodromy%matrix, shift)
      end if
      call judge_matrix(self, monodromy%matrix, variation%motion%omega(1))
   end subroutine judge_period

   !> Keeps the multipliers of a monodromy matrix and tells what they say, with the estimate that there is.
   subroutine judge_matrix(self, matrix, omega)
      type(stability_t), intent(inout) :: self
      real(wp), intent(in) :: matrix(:, :)
      real(wp), intent(in) :: omega                                   !! [rad/s]
      complex(wp), allocatable :: multipliers(:)
      real(wp) :: margin

      call eigenvalues_of(matrix, multipliers)
      if (size(multipliers) == 0) return
      margin = max(smallest_margin, safety*self%estimate)
      self%n_unstable = count(abs(multipliers) > 1.0_wp + margin)
      if (self%n_unstable > 0) then
         self%verdict = verdict%unstable
      else if (abs(multipliers(1)) < 1.0_wp - margin) then
         self%verdict = verdict%stable
      end if
      self%multipliers = multipliers(:min(size(multipliers), most_multipliers))
      self%exponents = log(max(abs(self%multipliers), tiny(1.0_wp)))*omega/two_pi
   end subroutine judge_matrix

   !> Whether a law leads through events that have no linearised equations here: rigid ones, and sliders without bounds.
   pure logical function has_to_be_marched(laws)
      type(law_box_t), intent(in) :: laws(:)
      integer :: i

      has_to_be_marched = .false.
      do i = 1, size(laws)
         select type (law => laws(i)%law)
         class is (hysteretic_law_t)
            has_to_be_marched = has_to_be_marched .or. .not. law%has_bounds
         end select
         has_to_be_marched = has_to_be_marched .or. laws(i)%law%is_multiplier
      end do
   end function has_to_be_marched

   !> The same as `find_stability` by marching a period of one tone from the motion and from beside it, for laws that ask for it:
   !> multipliers are those of the motion that repeats there, their change from the motion given is the least of the estimate.
   subroutine find_marched_stability(self, config, system, tuples, tones, amplitudes, restitution, work_allowed)
      type(stability_t), intent(out) :: self
      type(stability_config_t), intent(in) :: config
      type(march_system_t), intent(inout), target :: system
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      type(tones_t), intent(in) :: tones                              !! of the motion
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_dofs, n_harmonics)
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: work_allowed                            !! in about a nanosecond
      type(error_t), allocatable :: error
      type(motion_series_t) :: motion
      type(period_map_t) :: map
      type(stability_t) :: before

      if (config%method == stability_method%off .or. tones%n_tones > 1) return
      call system%structure%refuse_large("stability", most_dense, error)
      if (allocated(error)) return
      call new_motion_series(motion, tuples, tones%omega, amplitudes)
      call new_period_map(map, system, motion, restitution, config%tolerance, error)
      if (allocated(error)) return
      if (config%method == stability_method%auto .and. work_of_period_map(map, system) > work_allowed) return
      self%method = stability_method%march
      call find_period_map(map, system, tones%is_unknown(1), work_on_demand)
      if (.not. map%is_found) return
      self%estimate = map%estimate
      if (tones%is_unknown(1)) then
         self%estimate = max(self%estimate, norm2(matmul(map%matrix, map%shift) - map%shift)/norm2(map%shift))
         call deflate(map%matrix, map%shift)
         call deflate(map%first, map%shift)
      end if
      call judge_matrix(self, map%matrix, tones%omega(1))
      before%estimate = map%estimate
      call judge_matrix(before, map%first, tones%omega(1))
      call self%hold_against(before)
   end subroutine find_marched_stability
end module hb_stability
