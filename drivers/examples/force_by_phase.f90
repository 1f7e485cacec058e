!> A law of the program's own, in Fortran: a force given by the phase of the tone, in the place of a load. Cosine of the first
!> harmonic.
!>
!>     find_package(nhbm)
!>     target_link_libraries(force_by_phase nhbm::input)
module force_by_phase_law
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_int
   use nhbm, only: law_samples_t
   implicit none
   private
   public :: evaluate

contains

   !> f = -0.3 cos tau: what pushes is negative on the left-hand side.
   integer(c_int) function evaluate(samples) bind(c)
      type(law_samples_t), intent(in) :: samples
      real(c_double), pointer :: df_dz(:), f(:), phase(:, :)

      call c_f_pointer(samples%phases, phase, [samples%stride, samples%n_tones])
      call c_f_pointer(samples%f, f, [samples%n_samples])
      f = -0.3_c_double*cos(phase(:samples%n_samples, 1))
      if (c_associated(samples%df_dz)) then
         call c_f_pointer(samples%df_dz, df_dz, [samples%n_samples])
         df_dz = 0.0_c_double
      end if
      evaluate = 0
   end function evaluate
end module force_by_phase_law

program force_by_phase
   use, intrinsic :: iso_c_binding, only: c_funloc, c_funptr
   use force_by_phase_law, only: evaluate
   use nhbm, only: error_t, law_api, law_info_t, model_t, outcome, register_law
   implicit none
   character, parameter :: line = new_line("a")
   character(*), parameter :: text = &
      "&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0, "// &
      "damping_mass = 0.1 /"//line// &
      "&tones frequency = 0.9 /"//line// &
      "&law type = 'user', library = '', name = 'push', dof = 'x1' /"//line// &
      "&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /"
   type(model_t), target :: model
   type(c_funptr) :: force
   type(error_t), allocatable :: error

   force = c_funloc(evaluate)
   call register_law("push", law_info_t(api_version=law_api, n_coordinates=1, needs_phases=1), force, error)
   if (.not. allocated(error)) call model%read("push", text, error)
   if (.not. allocated(error)) call model%solve(.false., error)
   if (allocated(error)) error stop error%message
   if (model%result%status == outcome%converged) print "(es24.16)", model%result%coefficients(1, 2, 1)
   call model%destroy()
end program force_by_phase
