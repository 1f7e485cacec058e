!> FFTW 3 behind a few types: aligned memory, batched real n-dimensional plans, wisdom. Nobody else touches FFTW.
!>
!> Source of the interfaces: FFTW 3.3 manual, chapter "Calling FFTW from Modern Fortran".
module hb_fftw
   use, intrinsic :: iso_c_binding
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   implicit none
   private
   public :: complex_block_t, export_wisdom, fft_plan_t, forget_plans, import_wisdom, line_plan_t, new_complex_block, new_fft_plan
   public :: new_line_plan, new_real_block, planning, planning_names, real_block_t

   include 'fftw3.f03'

   !> Effort spent on the choice of an algorithm. `estimate` times nothing, so that every run and every MPI rank gets
   !> the same plan and therefore bitwise the same numbers; the others are reproducible only with a wisdom file.
   type :: planning_t
      integer :: estimate = int(FFTW_ESTIMATE)
      integer :: measure = int(FFTW_MEASURE)
      integer :: patient = int(FFTW_PATIENT)
   end type planning_t
   type(planning_t), parameter :: planning = planning_t()
   character(8), parameter :: planning_names(3) = [character(8) :: "estimate", "measure", "patient"]

   !> Real array (n, m) in memory aligned for SIMD transforms.
   type :: real_block_t
      real(wp), pointer, contiguous :: values(:, :) => null()
      type(c_ptr), private :: memory = c_null_ptr
   contains
      procedure :: destroy => real_block_destroy
   end type real_block_t

   !> Complex array (n, m) in memory aligned for SIMD transforms.
   type :: complex_block_t
      complex(wp), pointer, contiguous :: values(:, :) => null()
      type(c_ptr), private :: memory = c_null_ptr
   contains
      procedure :: destroy => complex_block_destroy
   end type complex_block_t

   !> A pair of plans, spectrum -> samples and samples -> spectrum, for `n_batch` transforms of one shape.
   type :: fft_plan_t
      type(c_ptr), private :: backward = c_null_ptr
      type(c_ptr), private :: forward = c_null_ptr
      integer, private :: slot = 0                                    ! in the store, 0: none
   contains
      procedure :: to_samples => fft_plan_to_samples
      procedure :: to_spectrum => fft_plan_to_spectrum
      procedure :: destroy => fft_plan_destroy
   end type fft_plan_t

   !> A pair of plans of complex transforms in place, along one axis of a spectrum.
   type :: line_plan_t
      type(c_ptr), private :: backward = c_null_ptr
      type(c_ptr), private :: forward = c_null_ptr
      integer, private :: slot = 0                                    ! in the store, 0: none
   contains
      procedure :: run_backward => line_plan_run_backward
      procedure :: run_forward => line_plan_run_forward
      procedure :: destroy => line_plan_destroy
   end type line_plan_t

   !> A pair of plans as it is kept from scene to scene: planning takes longer than many a solution.
   type :: stored_plan_t
      integer, allocatable :: key(:)                                  ! flags, n_batch, n_samples; of lines -1, flags, shape
      type(c_ptr) :: backward = c_null_ptr
      type(c_ptr) :: forward = c_null_ptr
      integer :: n_users = 0
      integer :: last_use = 0
   end type stored_plan_t

   type(stored_plan_t), save :: store(64)
   integer, save :: n_uses = 0

contains

   !> Allocates an aligned real array of shape (n, m), filled with zeros.
   subroutine new_real_block(self, n, m, error)
      type(real_block_t), intent(inout) :: self
      integer, intent(in) :: n, m
      type(error_t), allocatable, intent(out) :: error

      call self%destroy()
      self%memory = fftw_alloc_real(max(1_c_size_t, int(n, c_size_t)*int(m, c_size_t)))
      if (.not. c_associated(self%memory)) then
         call fail(error, "out of memory for samples of the torus")
         return
      end if
      call c_f_pointer(self%memory, self%values, [n, m])
      self%values = 0.0_wp
   end subroutine new_real_block

   !> Frees the array; safe to call twice.
   subroutine real_block_destroy(self)
      class(real_block_t), intent(inout) :: self

      if (c_associated(self%memory)) call fftw_free(self%memory)
      self%memory = c_null_ptr
      nullify (self%values)
   end subroutine real_block_destroy

   !> Allocates an aligned complex array of shape (n, m), filled with zeros.
   subroutine new_complex_block(self, n, m, error)
      type(complex_block_t), intent(inout) :: self
      integer, intent(in) :: n, m
      type(error_t), allocatable, intent(out) :: error

      call self%destroy()
      self%memory = fftw_alloc_complex(max(1_c_size_t, int(n, c_size_t)*int(m, c_size_t)))
      if (.not. c_associated(self%memory)) then
         call fail(error, "out of memory for the spectrum of the torus")
         return
      end if
      call c_f_pointer(self%memory, self%values, [n, m])
      self%values = (0.0_wp, 0.0_wp)
   end subroutine new_complex_block

   !> Frees the array; safe to call twice.
   subroutine complex_block_destroy(self)
      class(complex_block_t), intent(inout) :: self

      if (c_associated(self%memory)) call fftw_free(self%memory)
      self%memory = c_null_ptr
      nullify (self%values)
   end subroutine complex_block_destroy

   !> Plans `n_batch` real transforms of shape `n_samples` (first axis fastest), out of place, both ways.
   !>
   !> Samples of one transform are contiguous, (product(n_samples), n_batch); its spectrum is the half that FFTW keeps,
   !> (n_samples(1)/2 + 1, n_samples(2), ...), (n_spectrum, n_batch). The arrays given are overwritten while planning;
   !> arrays used later must come from `new_real_block` and `new_complex_block`. Plans outlive their users: the next of the
   !> same shape finds them made.
   subroutine new_fft_plan(self, n_samples, n_batch, effort, any_column, samples, spectrum, error)
      type(fft_plan_t), intent(inout) :: self
      integer, intent(in) :: n_samples(:)
      integer, intent(in) :: n_batch
      integer, intent(in) :: effort                                   !! one of `planning`
      logical, intent(in) :: any_column                               !! used from any column of a block, not just the first
      real(wp), intent(inout), contiguous :: samples(:, :)
      complex(wp), intent(inout), contiguous :: spectrum(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer(c_int) :: flags

      call self%destroy()
      flags = effort
      if (any_column .and. modulo(product(n_samples), 2) /= 0) flags = ior(flags, int(FFTW_UNALIGNED, c_int))
      self%slot = slot_of([int(flags), n_batch, n_samples])
      if (self%slot == 0) call fill_slot(self%slot, n_samples, n_batch, flags, samples, spectrum)
      if (self%slot == 0) then
         call fail(error, "FFTW could not plan the transform")
         return
      end if
      call take_pair(self%slot, self%backward, self%forward)
   end subroutine new_fft_plan

   !> Plans complex transforms of length `n` in place along an axis of stride `stride`: those that begin in the first `n_rows`
   !> elements of each of `n_blocks` blocks `block_stride` apart, for `n_batch` spectra, each a column of the array.
   subroutine new_line_plan(self, n, stride, n_rows, n_blocks, block_stride, effort, spectrum, n_batch, error)
      type(line_plan_t), intent(inout) :: self
      integer, intent(in) :: n, stride, n_rows, n_blocks, block_stride
      integer, intent(in) :: effort                                   !! one of `planning`
      complex(wp), intent(inout), contiguous, target :: spectrum(:, :)   !! from `new_complex_block`; overwritten
      integer, intent(in) :: n_batch
      type(error_t), allocatable, intent(out) :: error
      type(fftw_iodim) :: line(1), others(3)
      complex(wp), pointer, contiguous :: same(:, :)                  ! in place
      integer(c_int) :: flags
      integer, allocatable :: key(:)

      call self%destroy()
      flags = effort
      key = [-1, int(flags), n, stride, n_rows, n_blocks, block_stride, n_batch, size(spectrum, 1)]
      self%slot = slot_of(key)
      if (self%slot == 0) then
         self%slot = free_slot()
         if (self%slot > 0) then
            call c_f_pointer(c_loc(spectrum), same, shape(spectrum))
            line(1) = fftw_iodim(n, stride, stride)
            others(1) = fftw_iodim(n_rows, 1, 1)
            others(2) = fftw_iodim(n_blocks, block_stride, block_stride)
            others(3) = fftw_iodim(n_batch, size(spectrum, 1), size(spectrum, 1))
            associate (stored => store(self%slot))
               stored%backward = fftw_plan_guru_dft(1, line, 3, others, spectrum, same, FFTW_BACKWARD, flags)
               stored%forward = fftw_plan_guru_dft(1, line, 3, others, spectrum, same, FFTW_FORWARD, flags)
               if (c_associated(stored%backward) .and. c_associated(stored%forward)) then
                  stored%key = key
               else
                  call empty_slot(self%slot)
                  self%slot = 0
               end if
            end associate
         end if
      end if
      if (self%slot == 0) then
         call fail(error, "FFTW could not plan the transform")
         return
      end if
      call take_pair(self%slot, self%backward, self%forward)
   end subroutine new_line_plan

   !> One more user of a stored pair.
   subroutine take_pair(slot, backward, forward)
      integer, intent(in) :: slot
      type(c_ptr), intent(out) :: backward, forward

      associate (stored => store(slot))
         backward = stored%backward
         forward = stored%forward
         stored%n_users = stored%n_users + 1
         n_uses = n_uses + 1
         stored%last_use = n_uses
      end associate
   end subroutine take_pair

   !> Place of a pair of plans in the store, 0 where it is not there.
   pure integer function slot_of(key)
      integer, intent(in) :: key(:)

      do slot_of = 1, size(store)
         if (.not. allocated(store(slot_of)%key)) cycle
         if (size(store(slot_of)%key) /= size(key)) cycle
         if (all(store(slot_of)%key == key)) return
      end do
      slot_of = 0
   end function slot_of

   !> Plans a pair and puts it into a free place of the store, or into that of the pair not used for longest; 0 on failure.
   subroutine fill_slot(slot, n_samples, n_batch, flags, samples, spectrum)
      integer, intent(out) :: slot
      integer, intent(in) :: n_samples(:), n_batch
      integer(c_int), intent(in) :: flags
      real(wp), intent(inout), contiguous :: samples(:, :)
      complex(wp), intent(inout), contiguous :: spectrum(:, :)
      integer(c_int) :: rank, shape_c(size(n_samples)), n_total, n_spectrum

      slot = free_slot()
      if (slot == 0) return
      rank = size(n_samples)
      shape_c = n_samples(rank:1:-1)                                  ! C order: last axis fastest
      n_total = product(n_samples)
      n_spectrum = (n_samples(1)/2 + 1)*product(n_samples(2:))
      associate (stored => store(slot))
         stored%backward = fftw_plan_many_dft_c2r(rank, shape_c, n_batch, spectrum, shape_spectrum(), 1, n_spectrum, &
            samples, shape_c, 1, n_total, flags)
         stored%forward = fftw_plan_many_dft_r2c(rank, shape_c, n_batch, samples, shape_c, 1, n_total, &
            spectrum, shape_spectrum(), 1, n_spectrum, flags)
         if (c_associated(stored%backward) .and. c_associated(stored%forward)) then
            stored%key = [int(flags), n_batch, n_samples]
         else
            call empty_slot(slot)
            slot = 0
         end if
      end associate

   contains

      pure function shape_spectrum() result(n)
         integer(c_int) :: n(size(n_samples))

         n = shape_c
         n(rank) = n_samples(1)/2 + 1
      end function shape_spectrum
   end subroutine fill_slot

   !> An empty place of the store, made by giving up the pair not used for longest; 0 where all are in use.
   integer function free_slot() result(slot)
      integer :: i

      slot = 0
      do i = 1, size(store)
         if (store(i)%n_users > 0) cycle
         if (slot == 0) slot = i
         if (store(i)%last_use < store(slot)%last_use) slot = i
      end do
      if (slot > 0) call empty_slot(slot)
   end function free_slot

   subroutine empty_slot(slot)
      integer, intent(in) :: slot

      associate (stored => store(slot))
         if (c_associated(stored%backward)) call fftw_destroy_plan(stored%backward)
         if (c_associated(stored%forward)) call fftw_destroy_plan(stored%forward)
      end associate
      store(slot) = stored_plan_t()
   end subroutine empty_slot

   !> Transforms spectra to samples, unnormalised (sum of spectrum * exp(+i j tau)); the spectra are destroyed.
   subroutine fft_plan_to_samples(self, spectrum, samples)
      class(fft_plan_t), intent(in) :: self
      complex(wp), intent(inout), contiguous :: spectrum(:, :)
      real(wp), intent(inout), contiguous :: samples(:, :)

      call fftw_execute_dft_c2r(self%backward, spectrum, samples)
   end subroutine fft_plan_to_samples

   !> Transforms samples to spectra, unnormalised (sum of samples * exp(-i j tau)); the samples stay as they are.
   subroutine fft_plan_to_spectrum(self, samples, spectrum)
      class(fft_plan_t), intent(in) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)
      complex(wp), intent(inout), contiguous :: spectrum(:, :)

      call fftw_execute_dft_r2c(self%forward, samples, spectrum)
   end subroutine fft_plan_to_spectrum

   !> Gives the plans back to the store; safe to call twice.
   subroutine fft_plan_destroy(self)
      class(fft_plan_t), intent(inout) :: self

      if (self%slot > 0) store(self%slot)%n_users = store(self%slot)%n_users - 1
      self%slot = 0
      self%backward = c_null_ptr
      self%forward = c_null_ptr
   end subroutine fft_plan_destroy

   !> Transforms with exp(+i), unnormalised.
   subroutine line_plan_run_backward(self, spectrum)
      class(line_plan_t), intent(in) :: self
      complex(wp), intent(inout), contiguous :: spectrum(:, :)        !! shaped as that of the plan

      call fftw_execute_dft(self%backward, spectrum, spectrum)
   end subroutine line_plan_run_backward

   !> Transforms with exp(-i), unnormalised.
   subroutine line_plan_run_forward(self, spectrum)
      class(line_plan_t), intent(in) :: self
      complex(wp), intent(inout), contiguous :: spectrum(:, :)        !! shaped as that of the plan

      call fftw_execute_dft(self%forward, spectrum, spectrum)
   end subroutine line_plan_run_forward

   !> Gives the plans back to the store; safe to call twice.
   subroutine line_plan_destroy(self)
      class(line_plan_t), intent(inout) :: self

      if (self%slot > 0) store(self%slot)%n_users = store(self%slot)%n_users - 1
      self%slot = 0
      self%backward = c_null_ptr
      self%forward = c_null_ptr
   end subroutine line_plan_destroy

   !> Forgets all plans that nobody uses and what was learnt while planning, so that the next plans take as long as the
   !> first ones.
   subroutine forget_plans()
      integer :: slot

      do slot = 1, size(store)
         if (store(slot)%n_users == 0) call empty_slot(slot)
      end do
      call fftw_forget_wisdom()
   end subroutine forget_plans

   !> Reads wisdom of earlier runs from a file; false when there is none that can be used.
   logical function import_wisdom(path)
      character(*), intent(in) :: path

      import_wisdom = fftw_import_wisdom_from_filename(path//c_null_char) /= 0
   end function import_wisdom

   !> Writes the wisdom gathered so far to a file; false when the file cannot be written.
   logical function export_wisdom(path)
      character(*), intent(in) :: path

      export_wisdom = fftw_export_wisdom_to_filename(path//c_null_char) /= 0
   end function export_wisdom
end module hb_fftw
