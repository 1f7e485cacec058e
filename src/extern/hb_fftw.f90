!> FFTW 3 behind a few types: aligned memory, batched real n-dimensional plans, complex plans along an axis.
!> Plans are chosen without measurements, so that every run and every MPI rank has the same plan and therefore bitwise
!> the same numbers.
!> The only module that calls FFTW. Each thread may solve a model of its own: access to the store of plans and
!> planning are protected by a lock (hb_lock.h).
!>
!> Source of the interfaces: FFTW 3.3 manual, chapter "Calling FFTW from Modern Fortran".
module hb_fftw
   use, intrinsic :: iso_c_binding
   use hb_error, only: error_t, fail
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: axis_plan_t, complex_block_t, fft_plan_t, forget_plans, new_axis_plan
   public :: new_complex_block, new_fft_plan, new_real_block, real_block_t, two_together

   include 'fftw3.f03'

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
      type(real_block_t), private :: parts                            ! the same memory, real and imaginary parts in turn
   contains
      procedure :: destroy => complex_block_destroy
   end type complex_block_t

   !> A pair of plans, spectrum -> samples and samples -> spectrum, owned by the store.
   type :: plan_pair_t
      type(c_ptr), private :: backward = c_null_ptr
      type(c_ptr), private :: forward = c_null_ptr
      integer, private :: slot = 0                                    ! in the store, 0: none
   contains
      procedure :: destroy => plan_pair_destroy
   end type plan_pair_t

   !> Plans for `n_batch` real transforms of one shape.
   type, extends(plan_pair_t) :: fft_plan_t
   contains
      procedure :: to_samples => fft_plan_to_samples
      procedure :: to_spectrum => fft_plan_to_spectrum
   end type fft_plan_t

   !> Plans for complex transforms along one axis.
   type, extends(plan_pair_t) :: axis_plan_t
   contains
      procedure :: to_samples => axis_plan_to_samples
      procedure :: to_spectrum => axis_plan_to_spectrum
   end type axis_plan_t

   !> A pair of plans in the store, reused from model to model, because planning takes longer than many solutions.
   type :: stored_plan_t
      integer, allocatable :: key(:)                                  ! kind, n_batch, n_samples or the shape of an axis
      type(c_ptr) :: backward = c_null_ptr
      type(c_ptr) :: forward = c_null_ptr
      integer :: n_users = 0
      integer(int64) :: last_use = 0
   end type stored_plan_t

   integer, parameter :: small_block = 120                             ! size of a block for which the default alignment of
                                                                       !! memory suffices: aligned allocation takes longer than
                                                                       !! its transform
   integer, parameter :: is_real = 1, is_along_axis = 2                ! kinds of plans
   integer, parameter :: n_slots = 128                                ! in the store, unless more are in use at once
   type(stored_plan_t), allocatable, save :: store(:)
   integer(int64), save :: n_uses = 0
   integer(c_size_t), parameter :: min_values_of_large_pages = 524288  ! size of a block that large pages make faster: 4 MiB

   interface
      subroutine prefer_large_pages(memory, n_bytes) bind(c, name="hb_prefer_large_pages")
         import :: c_ptr, c_size_t
         type(c_ptr), value :: memory
         integer(c_size_t), value :: n_bytes
      end subroutine prefer_large_pages

      subroutine lock_store() bind(c, name="hb_lock")
      end subroutine lock_store

      subroutine unlock_store() bind(c, name="hb_unlock")
      end subroutine unlock_store
   end interface

contains

   !> Allocates an aligned real array of shape (n, m), filled with zeros.
   subroutine new_real_block(self, n, m, error)
      type(real_block_t), intent(inout) :: self
      integer, intent(in) :: n, m
      type(error_t), allocatable, intent(out) :: error

      call allocate_block(self, n, m, error)
      if (.not. allocated(error)) self%values = 0.0_wp
   end subroutine new_real_block

   !> Allocates an aligned real array of shape (n, m), whose pages the system provides when they are first used; one of this shape
   !> remains.
   subroutine allocate_block(self, n, m, error)
      type(real_block_t), intent(inout) :: self
      integer, intent(in) :: n, m
      type(error_t), allocatable, intent(out) :: error
      integer(c_size_t) :: n_values

      if (associated(self%values)) then
         if (all(shape(self%values) == [n, m])) return
      end if
      call self%destroy()
      n_values = int(n, c_size_t)*int(m, c_size_t)
      if (n_values <= small_block) then
         allocate (self%values(n, m))
         return
      end if
      self%memory = fftw_alloc_real(n_values)
      if (.not. c_associated(self%memory)) then
         call fail(error, "out of memory for samples of the torus")
         return
      end if
      if (n_values >= min_values_of_large_pages) call prefer_large_pages(self%memory, 8*n_values)
      call c_f_pointer(self%memory, self%values, [n, m])
   end subroutine allocate_block

   !> Frees the array; safe to call twice.
   subroutine real_block_destroy(self)
      class(real_block_t), intent(inout) :: self

      if (c_associated(self%memory)) then
         call fftw_free(self%memory)
      else if (associated(self%values)) then
         deallocate (self%values)
      end if
      self%memory = c_null_ptr
      nullify (self%values)
   end subroutine real_block_destroy

   !> Allocates an aligned complex array of shape (n, m), filled with zeros.
   subroutine new_complex_block(self, n, m, error)
      type(complex_block_t), intent(inout) :: self
      integer, intent(in) :: n, m
      type(error_t), allocatable, intent(out) :: error

      call new_real_block(self%parts, 2*n, m, error)
      if (.not. allocated(error)) call c_f_pointer(c_loc(self%parts%values), self%values, [n, m])
   end subroutine new_complex_block

   !> Frees the array; safe to call twice.
   subroutine complex_block_destroy(self)
      class(complex_block_t), intent(inout) :: self

      call self%parts%destroy()
      nullify (self%values)
   end subroutine complex_block_destroy

   !> Returns the memory of real numbers as complex ones, two neighbours in each.
   function two_together(values) result(pairs)
      real(wp), intent(in), contiguous, target :: values(:)           !! an even number of elements
      complex(wp), pointer, contiguous :: pairs(:)

      call c_f_pointer(c_loc(values), pairs, [size(values)/2])
   end function two_together

   !> Plans `n_batch` real transforms of shape `n_samples` (first axis fastest), out of place, in both directions.
   !>
   !> Samples of one transform are contiguous, (product(n_samples), n_batch); its spectrum is the half that FFTW
   !> stores, (n_samples(1)/2 + 1, n_samples(2), ...), (n_spectrum, n_batch). Arrays used later must come from
   !> `new_real_block` and `new_complex_block`. Plans remain in the store for the next user of the same shape.
   subroutine new_fft_plan(self, n_samples, n_batch, samples, spectrum, error)
      type(fft_plan_t), intent(inout) :: self
      integer, intent(in) :: n_samples(:)
      integer, intent(in) :: n_batch
      real(wp), intent(inout), contiguous :: samples(:, :)
      complex(wp), intent(inout), contiguous :: spectrum(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: key(:)
      integer :: slot
      type(c_ptr) :: backward, forward

      call self%destroy()
      key = [is_real, n_batch, n_samples]
      call lock_store()
      slot = slot_of(key)
      if (slot == 0) then
         call plan_real(n_samples, n_batch, samples, spectrum, backward, forward)
         call store_plans(key, backward, forward, slot)
      end if
      call borrow(self, slot, error)
      call unlock_store()
   end subroutine new_fft_plan

   !> Plans complex transforms of length `n` along the middle axis of arrays (leading, n, n_outer), out of place, in
   !> both directions, for the first `n_inner` positions of the leading axis, whose extent may differ between spectrum
   !> and samples.
   !>
   !> Executed from any other position of the leading axis they transform the `n_inner` columns from there on. Arrays
   !> used later must be aligned to 16 bytes, as each column of the blocks of this module is. Plans remain in the
   !> store.
   subroutine new_axis_plan(self, n, n_inner, n_outer, lead_spectrum, lead_samples, error)
      type(axis_plan_t), intent(inout) :: self
      integer, intent(in) :: n, n_inner, n_outer
      integer, intent(in) :: lead_spectrum, lead_samples              !! >= n_inner
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: key(:)
      integer :: slot
      type(c_ptr) :: backward, forward
      type(real_block_t) :: samples, spectrum                         ! complex numbers, which planning does not touch

      call self%destroy()
      key = [is_along_axis, n, n_inner, n_outer, lead_spectrum, lead_samples]
      call lock_store()
      slot = slot_of(key)
      if (slot == 0) then
         call allocate_block(spectrum, 2*lead_spectrum*n*n_outer, 1, error)
         if (.not. allocated(error)) call allocate_block(samples, 2*lead_samples*n*n_outer, 1, error)
         if (.not. allocated(error)) then
            call plan_axis(two_together(spectrum%values(:, 1)), two_together(samples%values(:, 1)))
            call store_plans(key, backward, forward, slot)
         end if
         call spectrum%destroy()
         call samples%destroy()
      end if
      if (.not. allocated(error)) call borrow(self, slot, error)
      call unlock_store()

   contains

      subroutine plan_axis(spectrum, samples)
         complex(wp), intent(inout), contiguous :: spectrum(:), samples(:)
         type(fftw_iodim) :: axis(1), batch(2)

         axis(1) = fftw_iodim(n, lead_spectrum, lead_samples)
         batch(1) = fftw_iodim(n_inner, 1, 1)
         batch(2) = fftw_iodim(n_outer, lead_spectrum*n, lead_samples*n)
         backward = fftw_plan_guru_dft(1, axis, 2, batch, spectrum, samples, FFTW_BACKWARD, FFTW_ESTIMATE)
         axis(1) = fftw_iodim(n, lead_samples, lead_spectrum)
         batch(2) = fftw_iodim(n_outer, lead_samples*n, lead_spectrum*n)
         forward = fftw_plan_guru_dft(1, axis, 2, batch, samples, spectrum, FFTW_FORWARD, FFTW_ESTIMATE)
      end subroutine plan_axis
   end subroutine new_axis_plan

   !> Returns the plans of a slot of the store and marks them as in use; fails if there are none.
   subroutine borrow(self, slot, error)
      class(plan_pair_t), intent(inout) :: self
      integer, intent(in) :: slot
      type(error_t), allocatable, intent(out) :: error

      if (slot == 0) then
         call fail(error, "FFTW could not plan the transform")
         return
      end if
      n_uses = n_uses + 1
      store(slot)%n_users = store(slot)%n_users + 1
      store(slot)%last_use = n_uses
      self%slot = slot
      self%backward = store(slot)%backward
      self%forward = store(slot)%forward
   end subroutine borrow

   !> Slot of a pair of plans in the store, 0 if it is not there.
   pure integer function slot_of(key)
      integer, intent(in) :: key(:)

      if (allocated(store)) then
         do slot_of = 1, size(store)
            if (.not. allocated(store(slot_of)%key)) cycle
            if (size(store(slot_of)%key) /= size(key)) cycle
            if (all(store(slot_of)%key == key)) return
         end do
      end if
      slot_of = 0
   end function slot_of

   !> Stores a pair in a free slot, or in that of the pair not used for longest; if all are in use, in a new one. The
   !> slot is 0 if planning failed.
   subroutine store_plans(key, backward, forward, slot)
      integer, intent(in) :: key(:)
      type(c_ptr), intent(in) :: backward, forward
      integer, intent(out) :: slot
      integer :: i

      slot = 0
      if (.not. (c_associated(backward) .and. c_associated(forward))) then
         if (c_associated(backward)) call fftw_destroy_plan(backward)
         if (c_associated(forward)) call fftw_destroy_plan(forward)
         return
      end if
      if (.not. allocated(store)) allocate (store(n_slots))
      do i = 1, size(store)
         if (store(i)%n_users > 0) cycle
         if (slot == 0) slot = i
         if (store(i)%last_use < store(slot)%last_use) slot = i
      end do
      if (slot == 0) then
         slot = size(store) + 1
         call enlarge_store()
      end if
      call empty_slot(slot)
      store(slot)%key = key
      store(slot)%backward = backward
      store(slot)%forward = forward
   end subroutine store_plans

   subroutine enlarge_store()
      type(stored_plan_t), allocatable :: larger(:)

      allocate (larger(size(store) + n_slots))
      larger(:size(store)) = store
      call move_alloc(larger, store)
   end subroutine enlarge_store

   subroutine plan_real(n_samples, n_batch, samples, spectrum, backward, forward)
      integer, intent(in) :: n_samples(:), n_batch
      real(wp), intent(inout), contiguous :: samples(:, :)
      complex(wp), intent(inout), contiguous :: spectrum(:, :)
      type(c_ptr), intent(out) :: backward, forward
      integer(c_int) :: rank, samples_c(size(n_samples)), spectrum_c(size(n_samples))

      rank = size(n_samples)
      samples_c = n_samples(rank:1:-1)                                ! C order: last axis fastest
      spectrum_c = samples_c
      spectrum_c(rank) = n_samples(1)/2 + 1
      backward = fftw_plan_many_dft_c2r(rank, samples_c, n_batch, spectrum, spectrum_c, 1, product(spectrum_c), &
                                        samples, samples_c, 1, product(samples_c), FFTW_ESTIMATE)
      forward = fftw_plan_many_dft_r2c(rank, samples_c, n_batch, samples, samples_c, 1, product(samples_c), &
                                       spectrum, spectrum_c, 1, product(spectrum_c), FFTW_ESTIMATE)
   end subroutine plan_real

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

   !> Transforms samples to spectra, unnormalised (sum of samples * exp(-i j tau)); the samples are preserved.
   subroutine fft_plan_to_spectrum(self, samples, spectrum)
      class(fft_plan_t), intent(in) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)
      complex(wp), intent(inout), contiguous :: spectrum(:, :)

      call fftw_execute_dft_r2c(self%forward, samples, spectrum)
   end subroutine fft_plan_to_spectrum

   !> Transforms spectra to samples along the axis (sum of spectrum * exp(+i j tau)), from columns that begin at the
   !> first elements of both; the spectra are preserved.
   subroutine axis_plan_to_samples(self, spectrum, samples)
      class(axis_plan_t), intent(in) :: self
      complex(wp), intent(inout) :: spectrum(*), samples(*)

      call fftw_execute_dft(self%backward, spectrum, samples)
   end subroutine axis_plan_to_samples

   !> Transforms samples to spectra along the axis (sum of samples * exp(-i j tau)); the samples are preserved.
   subroutine axis_plan_to_spectrum(self, samples, spectrum)
      class(axis_plan_t), intent(in) :: self
      complex(wp), intent(inout) :: samples(*), spectrum(*)

      call fftw_execute_dft(self%forward, samples, spectrum)
   end subroutine axis_plan_to_spectrum

   !> Returns the plans to the store; safe to call twice.
   subroutine plan_pair_destroy(self)
      class(plan_pair_t), intent(inout) :: self

      if (self%slot > 0) then
         call lock_store()
         store(self%slot)%n_users = store(self%slot)%n_users - 1
         call unlock_store()
      end if
      self%slot = 0
      self%backward = c_null_ptr
      self%forward = c_null_ptr
   end subroutine plan_pair_destroy

   !> Discards all plans not in use and all wisdom, so that the next plans take as long as the first ones.
   subroutine forget_plans()
      integer :: slot

      call lock_store()
      if (allocated(store)) then
         do slot = 1, size(store)
            if (store(slot)%n_users == 0) call empty_slot(slot)
         end do
      end if
      call fftw_forget_wisdom()
      call unlock_store()
   end subroutine forget_plans
end module hb_fftw
