!> A Duffing oscillator at five frequencies, each motion starting from the one before: frequency and cosine of the first harmonic.
!>
!>     find_package(nhbm)
!>     target_link_libraries(duffing nhbm::input)
program duffing
   use nhbm, only: error_t, model_t, outcome, wp
   implicit none
   character, parameter :: line = new_line("a")
   character(*), parameter :: text = &
      "&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0, "// &
      "damping_mass = 0.1 /"//line// &
      "&tones frequency = 0.9 /"//line// &
      "&load dof = 'x1', tuple = 1, cos = 0.3 /"//line// &
      "&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /"
   type(model_t), target :: model
   type(error_t), allocatable :: error
   real(wp) :: value
   integer :: tones, k

   call model%read("duffing", text, error)
   if (.not. allocated(error)) call model%locate("tones%frequency", tones, error)
   do k = 0, 4
      value = 0.5_wp + 0.25_wp*k
      if (.not. allocated(error)) call model%set(tones, "frequency", [value], error)
      if (.not. allocated(error)) call model%solve(k > 0, error)
      if (allocated(error)) error stop error%message
      if (model%result%status == outcome%converged) print "(f4.2, 1x, es24.16)", value, model%result%coefficients(1, 2, 1)
   end do
   call model%destroy()
end program duffing
