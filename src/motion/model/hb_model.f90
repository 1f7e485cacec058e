!> The model of one point of a study: a system, the discretisation in which it is solved, and the options of its solution.
!> hb_new_model makes models from numbers, hb_model_reader reads them from an input. What solves a system takes the three.
module hb_model
   use hb_discretisation, only: discretisation_t
   use hb_options, only: options_t
   use hb_system, only: system_t
   implicit none
   private
   public :: model_t

   type :: model_t
      logical :: is_read = .false.                                    !! from an input, without an error
      type(system_t) :: system
      type(discretisation_t) :: discretisation
      type(options_t) :: options
   end type model_t
end module hb_model
