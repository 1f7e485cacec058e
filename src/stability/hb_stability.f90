!> Whether a motion will be seen: what becomes of a small disturbance of it.
!>
!> One tone: Floquet multipliers, the eigenvalues of what a period makes of a disturbance; the motion is stable where all are smaller
!> than 1 in magnitude. One multiplier of a motion with a tone of its own is 1, the shift along itself: it is left out, and its
!> distance from 1 tells how good the motion is. Source: docs/user/theory.md, section 8.
module hb_stability
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_koopman_hill, only: find_hill_monodromy, hill_t, new_hill
   use hb_law, only: law_box_t
   use hb_monodromy, only: find_monodromy, monodromy_t, work_of_monodromy
   use hb_multipliers, only: deflate, eigenvalues_of
   use hb_structure, only: structure_t
   use hb_variation, only: new_variation, variation_t
   implicit none
   private
   public :: find_stability, n_multipliers_of, stability_config_t, stability_method, stability_method_names, stability_t, verdict

   integer, parameter :: most_multipliers = 16                        !! that are kept, the largest
   real(wp), parameter :: smallest_margin = 1.0e-9_wp                 ! of a multiplier from 1 that is sure
   real(wp), parameter :: safety = 10.0_wp                            ! on the estimate of the error
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
      real(wp) :: tolerance = 1.0e-6_wp                               !! of the monodromy matrix, relative
   end type stability_config_t

   type :: stability_t
      integer :: verdict = verdict%unknown
      integer :: n_unstable = 0                                       !! multipliers outside of the unit circle
      integer :: method = stability_method%off                        !! that was used
      real(wp) :: estimate = 0.0_wp                                   !! of the error of the monodromy matrix
      complex(wp), allocatable :: multipliers(:)                      !! the largest first; not allocated where none were found
   end type stability_t

contains

   !> Number of multipliers that are kept for a structure.
   pure integer function n_multipliers_of(n_dofs)
      integer, intent(in) :: n_dofs

      n_multipliers_of = min(2*n_dofs, most_multipliers)
   end function n_multipliers_of

   !> Finds out whether a motion is stable; `auto` does so where it takes no more work than allowed. What cannot be told
   !> stays unknown.
   subroutine find_stability(self, config, structure, laws, tuples, omega, is_unknown, amplitudes, work_allowed)
      type(stability_t), intent(out) :: self
      type(stability_config_t), intent(in) :: config
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      logical, intent(in) :: is_unknown(:)                            !! tones of the motion's own, (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_dofs, n_harmonics)
      real(wp), intent(in) :: work_allowed                            !! in about a nanosecond
      type(variation_t) :: variation
      type(error_t), allocatable :: error
      real(wp) :: work_limit

      if (config%method == stability_method%off .or. size(omega) > 1) return
      call new_variation(variation, structure, laws, tuples, omega, amplitudes, error)
      if (allocated(error)) return
      work_limit = work_on_demand
      if (config%method == stability_method%auto) then
         if (work_of_monodromy(variation) > work_allowed) return
      end if
      call judge_period(self, config, variation, amplitudes, is_unknown(1), work_limit)
   end subroutine find_stability

   !> Multipliers of a periodic motion.
   subroutine judge_period(self, config, variation, amplitudes, is_free, work_limit)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout) :: variation
      complex(wp), intent(in) :: amplitudes(:, :)
      logical, intent(in) :: is_free                                  !! the tone is the motion's own
      real(wp), intent(in) :: work_limit
      type(error_t), allocatable :: error
      type(hill_t) :: hill
      type(monodromy_t) :: monodromy
      complex(wp), allocatable :: multipliers(:)
      real(wp), allocatable :: shift(:)
      real(wp) :: margin
      integer :: n

      if (config%method == stability_method%hill .and. variation%is_smooth()) then
         self%method = stability_method%hill
         call new_hill(hill, variation, error)
         if (allocated(error)) return
         call find_hill_monodromy(hill, 0.0_wp, config%tolerance, monodromy%matrix, monodromy%estimate)
      else
         self%method = stability_method%march
         call find_monodromy(monodromy, variation, 0.0_wp, config%tolerance, work_limit)
      end if
      self%estimate = monodromy%estimate
      if (.not. all(ieee_is_finite(monodromy%matrix))) then
         return
      end if
      if (is_free) then
         n = size(amplitudes, 1)
         allocate (shift(size(monodromy%matrix, 1)), source=0.0_wp)
         associate (frequencies => variation%motion%frequencies)
            shift(:n) = matmul(-aimag(amplitudes), frequencies)
            shift(n + 1:2*n) = matmul(-real(amplitudes), frequencies**2)/variation%scale
         end associate
         call deflate(monodromy%matrix, shift)
      end if
      call eigenvalues_of(monodromy%matrix, multipliers)
      if (size(multipliers) == 0) return
      margin = max(smallest_margin, safety*monodromy%estimate)
      self%n_unstable = count(abs(multipliers) > 1.0_wp + margin)
      if (self%n_unstable > 0) then
         self%verdict = verdict%unstable
      else if (abs(multipliers(1)) < 1.0_wp - margin) then
         self%verdict = verdict%stable
      end if
      self%multipliers = multipliers(:min(size(multipliers), most_multipliers))
   end subroutine judge_period
end module hb_stability
