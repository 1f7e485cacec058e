!> Models for tests, made from namelist text as a user would write it.
module models
   use hb_balance, only: balance_t, new_balance
   use hb_document, only: document_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law_coordinates, only: laws_at
   use hb_model, only: model_t
   use hb_model_basis, only: coordinates_of
   use hb_model_reader, only: read_model
   use hb_motion, only: solve_motion
   use hb_motion_result, only: motion_result_t
   use hb_namelist, only: read_namelist
   use hb_run_callbacks, only: run_callbacks
   use random_numbers, only: fill_random
   use user_law_paths, only: user_law_samples
   implicit none
   private
   public :: balance_at, balance_of, law_example, law_place, make_model, message_of, one_group_a_line, paper_beam, &
      product_error, solve_text

   !> The paper's beam with its two loads; tones, harmonics and laws are still to be added.
   character(*), parameter :: paper_beam = &
      "&structure type='beam' length=1 bending_stiffness=1750 mass_per_length=7.8 n_elements=4 damping_diagonal=1 / "// &
      "&load dof='v3' tuple=1,0 cos=100 / &load dof='v3' tuple=0,1 cos=100 / "

contains

   !> Keys of a law with typical parameters, without the place where its first coordinate acts; a second one is at `x2`. Empty
   !> for a law that has no example yet.
   pure function law_example(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys

      select case (name)
      case ("annular_clearance"); keys = "stiffness=3 clearance=0.25 friction_coefficient=0.2 spin='negative' center=0.1,-0.05"
      case ("blade_contact"); keys = "n_diameters=3 n_blades=7 gaps=0.1,0,-0.2,0.3,0.1,0.05,0 stiffness=2 "// &
            "friction_coefficient=0.3 friction_arms=0.3,0.4 shares=1,0.9,1,1.1,1,1,1 frame='stationary' tone=1"
      case ("contact_table"); keys = "n_contacts=3 shapes=-1,0.5, 0.3,1, 0.8,-0.6 gaps=0.1,0,-0.2 stiffness=2,1.5,3 "// &
            "friction_coefficient=0.3 friction_shapes=0.5,1, -1,0.3, 0.6,0.8 tone=1 turns=2"
      case ("cubic_spring"); keys = "stiffness=1.5"
      case ("cubic_damping"); keys = "coefficient=0.6 speed=-0.7 n_diameters=2"
      case ("elastic_stop"); keys = "stiffness=3 gap=0.2 two_sided=.true."
      case ("coulomb_rigid"); keys = "limit=0.3 augmentation=1.3"
      case ("coulomb_tanh"); keys = "limit=0.7 velocity=0.4"
      case ("electrostatic"); keys = "coefficient=2 gap=3 voltage=1.5 tuple=2 voltage_cos=0.6 voltage_sin=-0.4"
      case ("hertz"); keys = "stiffness=3 gap=0.2 dissipation=0.3"
      case ("bouc_wen"); keys = "stiffness=2.5 post_yield_ratio=0.1 yield_displacement=0.3 exponent=1.7 beta=0.8"
      case ("iwan"); keys = "stiffness=1,2,0.5 limit=0.1,0.4,0.3"
      case ("jenkins_2d"); keys = "stiffness=2.5 limit=0.4 second_dofs='x2'"
      case ("jenkins"); keys = "stiffness=2.5 limit=0.4"
      case ("parametric"); keys = "tuple=2 stiffness_cos=0.6 stiffness_sin=-0.4 damping_cos=0.3 damping_sin=0.2"
      case ("rolling_bearing")
         keys = "second_dofs='x2' tuple=2 n_balls=5 stiffness=4 exponent=1.5 clearance=-0.2"
      case ("short_bearing"); keys = "second_dofs='x2' viscosity=5 radius=2 length=1.5 clearance=8 rotor_speed=0.7"
      case ("piecewise_linear"); keys = "breakpoints=-0.3,0.1,0.4 slopes=2,0.5,-0.3,1.5 force_at_zero=0.2"
      case ("polynomial"); keys = "stiffness=0.3,-0.5,0.7 damping=0.1,0.2,0.4"
      case ("polynomial_coupled"); keys = "coefficients=0.7,-0.4,0.5,0.3 acts_on='x1','x2','x2','x1' "// &
            "displacement_exponents=1,2, 3,0, 0,1, 0,0 velocity_exponents=0,0, 0,0, 1,1, 2,1"
      case ("quadratic_damping"); keys = "coefficient=0.6"
      case ("rigid_wall"); keys = "gap=0.2 augmentation=2.5 two_sided=.true."
      case ("stribeck"); keys = "limit=0.4 static_limit=0.7 stribeck_velocity=0.5 velocity=0.2 belt_velocity=0.3"
      case ("tabulated"); keys = "displacements=-0.6,-0.2,0,0.3,0.5 forces=-1,-0.3,0,0.1,0.9"
      case ("user"); keys = "library='"//user_law_samples//"' name='coupled' parameters=0.7,0.4"
      case ("van_der_pol"); keys = "strength=0.4 threshold=0.8"
      case default; keys = ""
      end select
   end function law_example

   !> Where a law of `law_example` acts in a structure that has x1 and x2.
   pure function law_place(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys

      select case (name)
      case ("annular_clearance", "contact_table", "cubic_damping", "polynomial_coupled", "user"); keys = "dofs='x1','x2'"
      case ("blade_contact"); keys = "dofs='x1','x2','x3','x4'"
      case default; keys = "dof='x1'"
      end select
   end function law_place

   !> Reads a model.
   subroutine make_model(text, model, error)
      character(*), intent(in) :: text
      type(model_t), intent(out) :: model
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document

      call read_namelist(document, "test.nml", one_group_a_line(text), error)
      if (.not. allocated(error)) call read_model(model, document, error, callbacks=run_callbacks())
   end subroutine make_model

   !> Message of an error, empty without one: a test that expects none says what went wrong.
   pure function message_of(error) result(message)
      type(error_t), allocatable, intent(in) :: error
      character(:), allocatable :: message

      message = ""
      if (allocated(error)) message = error%message
   end function message_of

   !> Breaks the text after each group, as a namelist file needs it.
   pure function one_group_a_line(text) result(lines)
      character(*), intent(in) :: text
      character(:), allocatable :: lines
      integer :: i

      lines = text
      do i = 1, len(lines) - 2
         if (lines(i:i + 2) == "/ &") lines(i + 1:i + 1) = new_line("a")
      end do
   end function one_group_a_line

   !> Balance of a model; the caller destroys it.
   subroutine balance_of(model, balance, error)
      type(model_t), intent(in) :: model
      type(balance_t), intent(inout) :: balance
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness

      associate (frequencies => model%discretisation%harmonics%frequencies(model%system%tones%omega))
         call new_dynamic_stiffness(stiffness, model%system%structure, coordinates_of(model%system), frequencies, &
                                    model%discretisation%loads, error)
         if (allocated(error)) return
         call new_balance(balance, model%discretisation%harmonics, model%discretisation%torus, model%system%tones%omega, &
                          stiffness, laws_at(stiffness%coordinates, model%system%laws), error)
      end associate
   end subroutine balance_of

   !> Balance of a model at other base frequencies, on its grid, with the derivatives of the dynamic stiffness; the caller
   !> destroys it.
   subroutine balance_at(model, omega, balance, error)
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      type(balance_t), intent(inout) :: balance
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness

      associate (frequencies => model%discretisation%harmonics%frequencies(omega))
         call new_dynamic_stiffness(stiffness, model%system%structure, coordinates_of(model%system), frequencies, &
                                    model%discretisation%loads, error, &
                                 wanted_slopes_t(.true., loads=model%discretisation%load_slopes))
         if (allocated(error)) return
         call new_balance(balance, model%discretisation%harmonics, model%discretisation%torus, omega, stiffness, &
                          laws_at(stiffness%coordinates, model%system%laws), error)
      end associate
   end subroutine balance_at

   !> Reads and solves a model.
   subroutine solve_text(text, model, result, error)
      character(*), intent(in) :: text
      type(model_t), intent(out) :: model
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error

      call make_model(text, model, error)
      if (.not. allocated(error)) call solve_motion(model, result, error)
   end subroutine solve_text
   !> Largest difference between products with the tangent and with its matrix, relative to the largest product, for a few
   !> random vectors; huge where there are no products.
   real(wp) function product_error(balance, x)
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in), contiguous :: x(:)
      integer, parameter :: n_vectors = 3
      real(wp), allocatable :: jacobian(:, :), v(:, :), product(:)
      logical :: is_ready
      integer :: i

      allocate (jacobian(size(x), size(x)), v(size(x), n_vectors), product(size(x)))
      call balance%tangent(x, jacobian)
      call balance%linearise(x, is_ready)
      product_error = huge(1.0_wp)
      if (.not. is_ready) return
      call fill_random(31, v)
      product_error = 0.0_wp
      do i = 1, n_vectors
         call balance%apply_tangent(v(:, i), product)
         product_error = max(product_error, maxval(abs(product - matmul(jacobian, v(:, i))))/maxval(abs(product)))
      end do
   end function product_error
end module models
