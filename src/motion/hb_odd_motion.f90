!> Half the unknowns where equations are odd: a scene with the odd tuples of its set alone, on half of its grid.
!>
!> The motion found balances all harmonics, the even ones vanish on both sides. Whether other motions exist beside it is
!> another question: `symmetry = 'none'` looks among all. Source: docs/user/theory.md, section 2.
module hb_odd_motion
   use hb_certificate, only: choose_wider_set
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_of_parity
   use hb_hysteretic_law, only: has_memory
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_odd_symmetry, only: even_part
   use hb_scene, only: scene_t, symmetry
   use hb_scene_symmetry, only: half_of_odd, is_solved_odd
   use hb_torus, only: torus_t
   use hb_two_level, only: exchange
   implicit none
   private
   public :: odd_motion_t, reduce_to_odd

   real(wp), parameter :: rounding = 1.0e-10_wp                       ! even part of a first guess that counts as none
   real(wp), parameter :: largest_asymmetry = 1.0e-8_wp               ! of forces with memory, relative

   type :: odd_motion_t
      logical :: is_used = .false.
      logical, private :: has_memory = .false.
      type(harmonics_t), private :: harmonics                         ! of the scene, as all that follows
      type(torus_t), private :: torus
      complex(wp), allocatable, private :: loads(:, :), load_slopes(:, :), start(:, :)
   contains
      procedure :: is_proven => odd_motion_is_proven
      procedure :: restore => odd_motion_restore
      procedure :: restore_result => odd_motion_restore_result
      procedure :: restore_unknowns => odd_motion_restore_unknowns
   end type odd_motion_t

contains

   !> Takes the even tuples and half the grid out of a scene, until `restore`, where its equations are odd, its first guess has
   !> nothing to the contrary and the user has not asked for all tuples; and out of a first guess as hb_motion has it.
   subroutine reduce_to_odd(self, scene, error, guess)
      type(odd_motion_t), intent(out) :: self
      type(scene_t), intent(inout) :: scene
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(inout), optional :: guess(:)
      type(harmonics_t) :: odd

      if (.not. is_solved_odd(scene)) return
      if (present(guess) .and. scene%symmetry == symmetry%auto) then
         if (.not. is_odd_guess(guess)) return
      end if
      call new_of_parity(odd, scene%harmonics, 1, error)
      if (allocated(error)) return
      self%is_used = .true.
      self%has_memory = has_memory(scene%laws)
      self%harmonics = scene%harmonics
      self%torus = scene%torus
      call take_odd(scene%loads, self%loads)
      call take_odd(scene%load_slopes, self%load_slopes)
      call take_odd(scene%start, self%start)
      if (present(guess)) call take_odd_guess(guess)
      scene%harmonics = odd
      scene%torus = half_of_odd(scene)

   contains

      logical function is_odd_guess(guess)
         real(wp), allocatable, intent(in) :: guess(:)

         is_odd_guess = .true.
         if (.not. allocated(guess)) return
         associate (n => scene%harmonics%n_coefficients, n_tones => scene%tones%n_tones)
            is_odd_guess = even_part(scene%harmonics, reshape(guess(:size(guess) - n_tones), [n, (size(guess) - n_tones)/n])) &
                           <= rounding
         end associate
      end function is_odd_guess

      subroutine take_odd(amplitudes, all_amplitudes)
         complex(wp), allocatable, intent(inout) :: amplitudes(:, :)
         complex(wp), allocatable, intent(out) :: all_amplitudes(:, :)
         integer :: h

         call move_alloc(amplitudes, all_amplitudes)
         allocate (amplitudes(size(all_amplitudes, 1), odd%n_harmonics))
         do h = 1, odd%n_harmonics
            amplitudes(:, h) = all_amplitudes(:, self%harmonics%index_of(odd%tuples(:, h)))
         end do
      end subroutine take_odd

      subroutine take_odd_guess(guess)
         real(wp), allocatable, intent(inout) :: guess(:)

         if (allocated(guess)) guess = exchanged(self%harmonics, odd, scene%tones%n_tones, guess)
      end subroutine take_odd_guess
   end subroutine reduce_to_odd

   !> Coefficients of another set, followed by the base frequencies.
   function exchanged(from_set, to_set, n_tones, from) result(to)
      type(harmonics_t), intent(in) :: from_set, to_set
      integer, intent(in) :: n_tones
      real(wp), intent(in) :: from(:)
      real(wp), allocatable :: to(:)
      real(wp), allocatable :: u(:, :)
      integer :: n, n_columns

      n = size(from) - n_tones
      n_columns = n/from_set%n_coefficients
      allocate (u(to_set%n_coefficients, n_columns))
      call exchange(from_set, to_set, reshape(from(:n), [from_set%n_coefficients, n_columns]), u)
      to = [u, from(n + 1:)]
   end function exchanged

   !> Whether the motion found balances the even harmonics too. Of laws with memory this shows in their forces: a slider that
   !> starts at rest and never slips again stays on one side.
   pure logical function odd_motion_is_proven(self, result) result(is_proven)
      class(odd_motion_t), intent(in) :: self
      type(motion_result_t), intent(in) :: result

      is_proven = .not. self%has_memory .or. result%asymmetry <= largest_asymmetry
   end function odd_motion_is_proven

   !> Gives a scene back what was taken out.
   subroutine odd_motion_restore(self, scene)
      class(odd_motion_t), intent(inout) :: self
      type(scene_t), intent(inout) :: scene

      if (.not. self%is_used) return
      scene%harmonics = self%harmonics
      scene%torus = self%torus
      call move_alloc(self%loads, scene%loads)
      call move_alloc(self%load_slopes, scene%load_slopes)
      call move_alloc(self%start, scene%start)
   end subroutine odd_motion_restore

   !> Puts the result of a reduced scene onto the whole set, after `restore`; coefficients of even tuples are zero.
   subroutine odd_motion_restore_result(self, result, error)
      class(odd_motion_t), intent(in) :: self
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: odd, wider
      real(wp), allocatable :: improved(:, :)

      call new_of_parity(odd, self%harmonics, 1, error)
      if (allocated(error)) return
      result%is_odd = .true.
      result%n_harmonics = self%harmonics%n_harmonics
      call fill(odd, self%harmonics, result%coefficients)
      call fill(odd, self%harmonics, result%force_coefficients)
      call fill(odd, self%harmonics, result%corrected_coefficients)
      associate (found => result%certificate)
         if (.not. allocated(found%improved)) return
         call choose_wider_set(self%harmonics, wider, error)
         if (allocated(error)) return
         call fill(found%wider, wider, result%improved_coefficients)
         allocate (improved(wider%n_coefficients, size(found%improved, 2)))
         call exchange(found%wider, wider, found%improved, improved)
         call move_alloc(improved, found%improved)
         found%wider = wider
      end associate

   contains

      subroutine fill(from_set, to_set, coefficients)
         type(harmonics_t), intent(in) :: from_set, to_set
         real(wp), allocatable, intent(inout) :: coefficients(:, :, :)
         real(wp), allocatable :: odd_coefficients(:, :, :)
         integer :: h

         if (.not. allocated(coefficients)) return
         call move_alloc(coefficients, odd_coefficients)
         allocate (coefficients(2, to_set%n_harmonics, size(odd_coefficients, 3)), source=0.0_wp)
         do h = 1, from_set%n_harmonics
            coefficients(:, to_set%index_of(from_set%tuples(:, h)), :) = odd_coefficients(:, h, :)
         end do
      end subroutine fill
   end subroutine odd_motion_restore_result

   !> The same for unknowns as hb_motion has them.
   subroutine odd_motion_restore_unknowns(self, n_tones, unknowns)
      class(odd_motion_t), intent(in) :: self
      integer, intent(in) :: n_tones
      real(wp), allocatable, intent(inout) :: unknowns(:)
      type(harmonics_t) :: odd
      type(error_t), allocatable :: error

      if (.not. allocated(unknowns)) return
      call new_of_parity(odd, self%harmonics, 1, error)
      unknowns = exchanged(odd, self%harmonics, n_tones, unknowns)
   end subroutine odd_motion_restore_unknowns
end module hb_odd_motion
