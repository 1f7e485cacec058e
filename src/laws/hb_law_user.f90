!> A law of the user, from a shared library loaded at run time.
!>
!> The functions that the library exports, their arguments and return codes are documented in nhbm_user_law.h, the C header
!> of this interface. Sign: f stands beside K q on the left-hand side.
module hb_law_user
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_error, only: error_t, fail
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t
   use hb_numbers, only: numbers_t
   use hb_problems, only: problems_t
   use hb_text, only: to_text
   use hb_user_library, only: any_number, law_input_t, load_user_library, user_library_t
   implicit none
   private
   public :: adopt_memory, load_user_law, user_memory_t, user_t

   type, extends(law_t) :: user_t
      character(:), allocatable :: name                               !! prefix of the functions
      real(wp), allocatable :: parameters(:)
      type(user_library_t), private :: library
      real(wp), allocatable, private :: phases(:, :)                  ! [rad], (n_samples, n_tones), if it needs them
      real(wp), allocatable, private :: omega(:)                      ! [rad/s], (n_tones), if it needs them
   contains
      procedure :: declare_numbers => user_law_declare_numbers
      procedure :: check => user_law_check
      procedure :: set_phases => user_law_set_phases
      procedure :: set_frequencies => user_law_set_frequencies
      procedure :: frequency_slope => user_law_frequency_slope
      procedure :: evaluate => user_law_evaluate
      procedure :: explain => user_law_explain
      procedure :: fingerprint => user_law_fingerprint
      procedure :: has_touched_inputs => user_law_has_touched_inputs
   end type user_t

   !> A law of the user that has states.
   type, extends(hysteretic_law_t) :: user_memory_t
      type(user_t), private :: own
   contains
      procedure :: declare_numbers => user_memory_declare_numbers
      procedure :: advance => user_memory_advance
      procedure :: force => user_memory_force
      procedure :: fingerprint => user_memory_fingerprint
   end type user_memory_t

contains

   !> Loads the law `name` from a library; fails if it cannot be loaded or has another number of parameters.
   subroutine load_user_law(self, library, name, parameters, error)
      class(user_t), intent(inout) :: self
      character(*), intent(in) :: library                             !! path; empty: the program itself
      character(*), intent(in) :: name                                !! prefix of the functions
      real(wp), intent(in) :: parameters(:)
      type(error_t), allocatable, intent(out) :: error

      call load_user_library(self%library, library, name, error)
      if (allocated(error)) return
      if (all(self%library%n_parameters /= [any_number, size(parameters)])) then
         call fail(error, "'"//name//"' takes "//to_text(self%library%n_parameters)//" parameters, not "// &
                   to_text(size(parameters)))
         return
      end if
      self%name = name
      self%parameters = parameters
      self%needs_velocity = self%library%needs_velocity
      self%degree = self%library%degree
      self%is_users_own = .true.
      self%length_scale = self%library%length_scale
      self%n_phases = merge(1, 0, self%library%needs_phases)
      self%needs_frequencies = self%library%needs_frequencies
      self%n_states = self%library%n_states
   end subroutine load_user_law

   subroutine user_law_declare_numbers(self, numbers)
      class(user_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("parameters", self%parameters)
   end subroutine user_law_declare_numbers

   !> Whether the library expects the coordinates of the law, and what the user declares is possible.
   subroutine user_law_check(self, problems)
      class(user_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (self%is_odd .and. self%n_phases > 0) call problems%add("odd", "a law that needs phases cannot be declared odd")
      if (.not. (allocated(self%shape) .and. allocated(self%name))) return
      if (all(self%library%n_coordinates /= [any_number, size(self%shape, 2)])) &
         call problems%add("dofs", "'"//self%name//"' takes "//to_text(self%library%n_coordinates)//" coordinates, not "// &
                           to_text(size(self%shape, 2)))
   end subroutine user_law_check

   !> Returns NaN throughout if the library reports a failure, so that the residual is not finite there.
   subroutine user_law_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(user_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      type(law_input_t) :: input

      input = law_input_t(self%parameters, z, v, self%phases, self%omega)
      if (self%library%evaluate(input, f, df_dz, df_dv) == 0) return
      f = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dz)) df_dz = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dv)) df_dv = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine user_law_evaluate

   !> Calls the library again to explain the failure.
   subroutine user_law_explain(self, z, v, text, is_fatal)
      class(user_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)
      character(:), allocatable, intent(out) :: text
      logical, intent(out) :: is_fatal
      type(law_input_t) :: input
      real(wp) :: f(size(z, 1), size(z, 2))
      integer :: code

      input = law_input_t(self%parameters, z, v, self%phases, self%omega)
      code = self%library%evaluate(input, f)
      is_fatal = code < 0
      if (code /= 0) then
         text = "'"//self%name//"_evaluate' returned "//to_text(code)
      else if (.not. all(ieee_is_finite(f))) then
         text = "'"//self%name//"_evaluate' gave NaN or infinity for a force"
      else
         text = "'"//self%name//"_evaluate' gave NaN or infinity for a derivative"
      end if
   end subroutine user_law_explain

   !> Its name, and the fingerprint of the library.
   function user_law_fingerprint(self) result(text)
      class(user_t), intent(in) :: self
      character(300) :: text

      text = self%name//", "//self%library%fingerprint()
   end function user_law_fingerprint

   !> Calls the library again and checks whether it writes to its input arguments.
   logical function user_law_has_touched_inputs(self, z, v) result(has_touched)
      class(user_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :)                        !! as `evaluate` has them

      has_touched = self%library%has_touched(law_input_t(self%parameters, z, v, self%phases, self%omega))
   end function user_law_has_touched_inputs

   pure subroutine user_law_set_phases(self, phases)
      class(user_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)

      self%phases = transpose(phases)
   end subroutine user_law_set_phases

   pure subroutine user_law_set_frequencies(self, omega)
      class(user_t), intent(inout) :: self
      real(wp), intent(in) :: omega(:)

      if (self%needs_frequencies) self%omega = omega
   end subroutine user_law_set_frequencies

   !> By central differences.
   subroutine user_law_frequency_slope(self, z, v, tone, slope)
      class(user_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)
      integer, intent(in) :: tone
      real(wp), intent(out), contiguous :: slope(:, :)
      real(wp), parameter :: relative_step = epsilon(1.0_wp)**(1.0_wp/3.0_wp) ! relative
      type(law_input_t) :: input
      real(wp) :: lower(size(slope, 1), size(slope, 2)), h
      integer :: codes(2)

      input = law_input_t(self%parameters, z, v, self%phases, self%omega)
      h = relative_step*self%omega(tone)
      input%frequencies(tone) = self%omega(tone) + h
      codes(1) = self%library%evaluate(input, slope)
      input%frequencies(tone) = self%omega(tone) - h
      codes(2) = self%library%evaluate(input, lower)
      slope = (slope - lower)/(2.0_wp*h)
      if (any(codes /= 0)) slope = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine user_law_frequency_slope

   !> Converts a law with states, as it was read, to a law with memory if it is a user's; others are unchanged.
   subroutine adopt_memory(box)
      type(law_box_t), intent(inout) :: box
      type(user_memory_t), allocatable :: memory

      select type (law => box%law)
      type is (user_t)
         allocate (memory)
         memory%own = law
         memory%label = law%label
         if (allocated(law%dofs)) memory%dofs = law%dofs
         if (allocated(law%shape)) memory%shape = law%shape
         if (allocated(law%positions)) memory%positions = law%positions
         memory%n_states = law%n_states
         memory%is_users_own = .true.
         memory%is_odd = law%is_odd
         memory%length_scale = law%length_scale
      end select
      if (allocated(memory)) call move_alloc(memory, box%law)
   end subroutine adopt_memory

   subroutine user_memory_declare_numbers(self, numbers)
      class(user_memory_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call self%own%declare_numbers(numbers)
   end subroutine user_memory_declare_numbers

   !> Returns NaN throughout if the user's function reports a failure.
   subroutine user_memory_advance(self, s_old, path, s_new, ds_ds_old, ds_dpath)
      class(user_memory_t), intent(in) :: self
      real(wp), intent(in), contiguous :: s_old(:, :), path(:, :, :)
      real(wp), intent(out), contiguous :: s_new(:, :)
      real(wp), intent(out), contiguous, optional :: ds_ds_old(:, :, :), ds_dpath(:, :, :, :)

      if (self%own%library%advance(self%own%parameters, s_old, path, s_new, ds_ds_old, ds_dpath) == 0) return
      s_new = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(ds_ds_old)) ds_ds_old = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(ds_dpath)) ds_dpath = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine user_memory_advance

   subroutine user_memory_force(self, z, s, f, df_dz, df_ds)
      class(user_memory_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), s(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_ds(:, :, :)
      type(law_input_t) :: input

      input = law_input_t(self%own%parameters, z, z(:, 1:0), states=s)
      if (self%own%library%evaluate(input, f, df_dz, df_ds=df_ds) == 0) return
      f = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dz)) df_dz = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_ds)) df_ds = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine user_memory_force

   function user_memory_fingerprint(self) result(text)
      class(user_memory_t), intent(in) :: self
      character(300) :: text

      text = self%own%fingerprint()
   end function user_memory_fingerprint
end module hb_law_user
