!> Derivatives of the samples of all laws by a base frequency while all coefficients stay.
!>
!> Source: docs/theory.md, section 5.6.
module hb_frequency_samples
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   implicit none
   private
   public :: frequency_samples_t, new_frequency_samples

   !> Owner of outside resources: call `destroy`.
   type :: frequency_samples_t
      type(real_block_t) :: v, s, f                                   !! of rate, reaction, force, (n_samples, n_dofs)
      type(real_block_t) :: q_before, step_rate, step_rate_before     !! of what steps know of the motion
   contains
      procedure :: destroy => frequency_samples_destroy
   end type frequency_samples_t

contains

   !> Makes room for what the laws need.
   subroutine new_frequency_samples(self, n_samples, n_dofs, needs_velocity, needs_reaction, has_memory, error)
      type(frequency_samples_t), intent(inout) :: self
      integer, intent(in) :: n_samples, n_dofs
      logical, intent(in) :: needs_velocity, needs_reaction, has_memory !! of any law
      type(error_t), allocatable, intent(out) :: error

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
   end subroutine new_frequency_samples

   !> Frees all samples; safe to call twice.
   subroutine frequency_samples_destroy(self)
      class(frequency_samples_t), intent(inout) :: self

      call self%v%destroy()
      call self%s%destroy()
      call self%f%destroy()
      call self%q_before%destroy()
      call self%step_rate%destroy()
      call self%step_rate_before%destroy()
   end subroutine frequency_samples_destroy
end module hb_frequency_samples
