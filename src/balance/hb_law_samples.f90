!> Samples of the coordinates and forces of all laws of a model on one torus: of a motion, or their derivatives along
!> one direction, of the motion or with respect to a base frequency at constant coefficients. Source:
!> docs/why/theory.md, sections 5.3, 5.6 and 6.6.
module hb_law_samples
   use, intrinsic :: iso_fortran_env, only: int64
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   implicit none
   private
   public :: law_samples_t, new_law_samples

   !> Each (n_samples, n_dofs); arrays that no law needs are not allocated. Owner of external resources: call
   !> `destroy`.
   type :: law_samples_t
      integer(int64) :: n_motions = 0                                 !! that were sampled
      type(real_block_t) :: q                                         !! motion [m]
      type(real_block_t) :: v                                         !! rate [m/s]
      type(real_block_t) :: s                                         !! reaction that equilibrium requires [N]
      type(real_block_t) :: f                                         !! force of the laws [N]
      type(real_block_t) :: q_before                                  !! motion one step of time before each sample [m]
      type(real_block_t) :: step_rate, step_rate_before               !! rate times the step, there and one step before [m]
   contains
      procedure :: destroy => law_samples_destroy
   end type law_samples_t

contains

   !> Allocates the arrays that the laws need; those of this size remain.
   subroutine new_law_samples(self, n_samples, n_dofs, needs_velocity, needs_reaction, has_memory, error)
      type(law_samples_t), intent(inout) :: self
      integer, intent(in) :: n_samples, n_dofs
      logical, intent(in) :: needs_velocity, needs_reaction, has_memory !! of any law
      type(error_t), allocatable, intent(out) :: error

      self%n_motions = 0
      call make(self%q, .true.)
      call make(self%f, .true.)
      call make(self%v, needs_velocity)
      call make(self%s, needs_reaction)
      call make(self%q_before, has_memory)
      call make(self%step_rate, has_memory)
      call make(self%step_rate_before, has_memory)

   contains

      subroutine make(block, is_needed)
         type(real_block_t), intent(inout) :: block
         logical, intent(in) :: is_needed

         if (.not. is_needed) call block%destroy()
         if (is_needed .and. .not. allocated(error)) call new_real_block(block, n_samples, n_dofs, error)
      end subroutine make
   end subroutine new_law_samples

   !> Frees all samples; safe to call twice.
   subroutine law_samples_destroy(self)
      class(law_samples_t), intent(inout) :: self

      call self%q%destroy()
      call self%v%destroy()
      call self%s%destroy()
      call self%f%destroy()
      call self%q_before%destroy()
      call self%step_rate%destroy()
      call self%step_rate_before%destroy()
   end subroutine law_samples_destroy
end module hb_law_samples
