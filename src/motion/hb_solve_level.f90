!> Solves a level, in the base frequencies in which it needs the fewest samples.
module hb_solve_level
   use hb_base_change, only: base_change_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_level, only: level_t, set_to_level
   use hb_motion, only: solve_system
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_system, only: system_t
   implicit none
   private
   public :: solve_level

contains

   !> Solves a model on the set of a level, from a first guess if there is one. What it returns is in the given base.
   subroutine solve_level(system, whole, options, level, guess, result, error, found)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: whole                     !! has all loads
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: level
      real(wp), allocatable, intent(inout) :: guess(:)                !! unknowns as those of a level; lost
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(out) :: found(:)                  !! unknowns of the motion, if there is one
      type(discretisation_t) :: here
      type(base_change_t) :: base

      call base%choose(system, whole, options, level, guess)
      if (base%is_on) then
         here = base%discretisation
         call set_to_level(here, base%system, base%discretisation, options, base%level, error)
         if (.not. allocated(error)) call solve_system(base%system, here, options, result, error, guess, found)
         if (.not. allocated(error)) call base%bring_back(system, options, level%set, result, found)
      else
         here = whole
         call set_to_level(here, system, whole, options, level, error)
         if (.not. allocated(error)) call solve_system(system, here, options, result, error, guess, found)
      end if
   end subroutine solve_level
end module hb_solve_level
