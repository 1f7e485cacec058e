!> Self-excited motion: limit cycles and tori with unknown base frequencies, from the modes of the base motion; never the base
!> motion itself. Source: docs/why/theory.md, section 6.5.
module hb_self_excitation
   use hb_amplitude_curve, only: follow_curve
   use hb_amplitude_flow, only: follow_flow
   use hb_kinds, only: wp
   use hb_limit_cycle_search, only: first_amplitude, path_point_t, search_t
   use hb_outcome, only: outcome
   use hb_text, only: to_text
   implicit none
   private
   public :: search_from_modes

contains

   !> Searches from the modes of the search. When nothing is found, u is the motion at rest, and status and message tell what
   !> is known.
   subroutine search_from_modes(self, u, is_found)
      type(search_t), intent(inout) :: self
      real(wp), intent(out) :: u(:, :)                                !! [m], (n_coefficients, n_dofs)
      logical, intent(out) :: is_found
      type(path_point_t) :: point

      self%is_neutral = .true.
      self%is_left = .false.
      self%is_driven = .false.
      self%runs_away = .false.
      self%reached = 0.0_wp
      self%report%status = outcome%pending
      if (allocated(self%message)) deallocate (self%message)
      if (size(self%tones) == 1) then
         call follow_curve(self, point, is_found)
      else
         call follow_flow(self, point, is_found)
      end if
      u = self%base%u
      if (is_found) then
         u = point%u
         return
      end if
      self%report%residual = self%base%report%residual
      if (allocated(self%message) .and. self%report%status == outcome%stalled) return
      self%report%status = outcome%no_motion
      if (.not. self%runs_away .and. (self%base%is_forced .or. size(self%tones) > 1)) self%report%status = outcome%collapsed
      if (allocated(self%message)) return
      if (self%reached <= 0.0_wp) then
         self%report%status = outcome%stalled
         self%message = "no starting motion with small amplitudes of the unknown tones was found"
      else if (self%is_neutral) then
         self%message = "the unknown tone is neither excited nor damped: prescribe its amplitude in &normal_mode"
      else
         self%message = "damped at the amplitudes tried, "//to_text(self%length*first_amplitude)//" to "//to_text(self%reached)
      end if
   end subroutine search_from_modes
end module hb_self_excitation
