!> Derivatives of the samples of all laws along one direction: of the motion, or by a base frequency while all coefficients
!> stay. Source: docs/user/theory.md, sections 5.6 and 6.6.
module hb_direction_samples
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   implicit none
   private
   public :: direction_samples_t, new_direction_samples

   !> Owner of outside resources: call `destroy`.
   type :: direction_samples_t
      type(real_block_t) :: q, v, s, f                                !! of motion, rate, reaction, force, (n_samples, n_dofs)
      type(real_block_t) :: q_before, step_rate, step_rate_before     !! of what steps know of the motion
   contains
      procedure :: destroy => direction_samples_destroy
   end type direction_samples_t

contains

   !> Makes room for what the laws need.
   subroutine new_direction_samples(self, n_samples, n_dofs, needs_velocity, needs_reaction, has_memory, error)
      type(direction_samples_t), intent(inout) :: self
      integer, intent(in) :: n_samples, n_dofs
      logical, intent(in) :: needs_velocity, needs_reaction, has_memory !! of any law
      type(error_t), allocatable, intent(out) :: error

      call new_real_block(self%q, n_samples, n_dofs, error)
      if (allocated(error)) return
      if (needs_velocity) call new_real_block(self%v, n_samples, n_dofs, error)
      if (allocated(error)) return
      if (needs_reaction) call new_real_block(self%s, n_samples, n_dofs, error)
      if (allocated(error)) return
      if (has_memory) then
         call new_real_block(self%q_before, n_samples, n_dofs, error)
         if (allocated(error)) return
         call new_real_block(self%step_rate, n_samples, n_dofs, error)
         if (allocated(error)) return
         call new_real_block(self%step_rate_before, n_samples, n_dofs, error)
         if (allocated(error)) return
      end if
      call new_real_block(self%f, n_samples, n_dofs, error)
   end subroutine new_direction_samples

   !> Frees all samples; safe to call twice.
   subroutine direction_samples_destroy(self)
      class(direction_samples_t), intent(inout) :: self

      call self%q%destroy()
      call self%v%destroy()
      call self%s%destroy()
      call self%f%destroy()
      call self%q_before%destroy()
      call self%step_rate%destroy()
      call self%step_rate_before%destroy()
   end subroutine direction_samples_destroy
end module hb_direction_samples
