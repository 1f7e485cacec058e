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
   use law_examples_of_table, only: law_examples
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

   !> Keys of a law with typical parameters, without the place where its first coordinate acts; a second one is at `x2`: the
   !> example of the table of laws.
   pure function law_example(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys
      character(*), parameter :: library = "{samples}"
      integer :: start

      keys = example_of(name)
      keys = keys(index(keys, " ") + 1:)
      start = index(keys, library)
      if (start > 0) keys = keys(:start - 1)//user_law_samples//keys(start + len(library):)
   end function law_example

   !> Where a law of `law_example` acts in a structure that has x1 and x2.
   pure function law_place(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys

      keys = example_of(name)
      keys = keys(:index(keys, " ") - 1)
   end function law_place

   !> The example of a law; one blank if the table has no such law.
   pure function example_of(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys
      integer :: i

      keys = " "
      do i = 1, size(law_examples)
         if (index(law_examples(i), trim(name)//" | ") == 1) keys = trim(law_examples(i)(len_trim(name) + 4:))
      end do
   end function example_of

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
