!> Products of the tangent with a motion: the derivative of the forces of the laws along it, computed at the samples.
!> If laws have only sampled slopes, a smaller grid is exact: the contribution of a product of a slope g with a motion
!> to the retained harmonics, |j_m| <= N_m, depends on the spectrum of g up to 2 N_m. With that part of it, 4 N_m + 1
!> samples per tone avoid aliasing; contact forces are sampled on more. Source: docs/why/theory.md, section 6.6.
module hb_tangent_product
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_harmonics, only: harmonics_t, new_box, new_of_parity
   use hb_kinds, only: wp
   use hb_law_jacobian, only: law_jacobian_t
   use hb_law_samples, only: law_samples_t, new_law_samples
   use hb_packed_fft, only: direction
   use hb_projected_laws, only: projected_laws_t
   use hb_threads, only: n_threads, this_thread
   use hb_torus, only: cheap_size, new_torus, torus_t
   use hb_transform, only: new_transform, transform_t
   implicit none
   private
   public :: tangent_product_t

   !> Owner of external resources: call `destroy`.
   type :: thin_grid_t
      type(transform_t), private :: transform                         ! of motions
      type(transform_t), private :: wide, narrow                      ! of slopes, on the grid of the laws and on this one
      type(law_samples_t), private :: along                           ! a direction
      type(law_jacobian_t), private :: jacobian
      type(real_block_t), allocatable, private :: columns(:)          ! (n_lanes) of (n_samples, 1)
      real(wp), allocatable, private :: spectra(:, :)                 ! (coefficients of a slope, n_lanes)
   contains
      procedure :: update => thin_grid_update
      procedure :: apply => thin_grid_apply
      procedure, private :: bring => thin_grid_bring
      procedure :: destroy => thin_grid_destroy
   end type thin_grid_t

   !> Owner of external resources: call `destroy`.
   type :: tangent_product_t
      logical, private :: is_ready = .false.                          ! after the first use
      type(thin_grid_t), allocatable, private :: thin                 ! if it is coarser than the grid of the laws
      logical, private :: uses_thin = .false.                         ! for the motion of the last `prepare`
   contains
      procedure :: prepare => tangent_product_prepare
      procedure :: apply => tangent_product_apply
      procedure :: destroy => tangent_product_destroy
   end type tangent_product_t

contains

   !> Prepares products at the motion along which the laws were differentiated. Fails out of memory.
   subroutine tangent_product_prepare(self, laws, error)
      class(tangent_product_t), intent(inout) :: self
      type(projected_laws_t), intent(inout) :: laws
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%is_ready) call new_thin_grid(self%thin, laws%transform%harmonics, laws%transform%torus, laws)
      self%is_ready = .true.
      self%uses_thin = allocated(self%thin) .and. .not. laws%kinks%are_met()   ! the response to neighbours needs all samples
      if (self%uses_thin) then
         call self%thin%update(laws)
      else
         call laws%make_direction_samples(error)
      end if
   end subroutine tangent_product_prepare

   !> Computes the coefficients of the derivative of the forces along a motion u. Fails if that of a memory does not
   !> become periodic.
   subroutine tangent_product_apply(self, laws, u, reaction, frequencies, force, error)
      class(tangent_product_t), intent(inout) :: self
      type(projected_laws_t), intent(inout) :: laws
      real(wp), intent(in), contiguous :: u(:, :)                     !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in), contiguous :: reaction(:, :)              !! -S u [N], as u
      real(wp), intent(in), contiguous :: frequencies(:)              !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(out), contiguous :: force(:, :)                !! [N], as u
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: weight_slope(:)

      if (self%uses_thin) then
         call self%thin%apply(frequencies, u, reaction, force)
         return
      end if
      allocate (weight_slope(0))
      if (laws%has_memory) weight_slope = 0.0_wp*laws%characteristic%weight
      call laws%bring_to(laws%along, u, reaction, frequencies)
      call laws%differentiate_along(error, weight_slope)
      call laws%transform%to_coefficients(laws%along%f%values, force)
   end subroutine tangent_product_apply

   !> Frees the memory of products; safe to call twice.
   subroutine tangent_product_destroy(self)
      class(tangent_product_t), intent(inout) :: self

      self%is_ready = .false.
      if (.not. allocated(self%thin)) return
      call self%thin%destroy()
      deallocate (self%thin)
   end subroutine tangent_product_destroy

   !> Prepares products for the laws, if a coarser grid suffices and there is memory for it; otherwise not allocated,
   !> as products on the grid of the laws are as exact.
   subroutine new_thin_grid(self, harmonics, torus, laws)
      type(thin_grid_t), allocatable, intent(out) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus                              !! of the laws
      type(projected_laws_t), intent(in) :: laws
      type(error_t), allocatable :: error
      integer, parameter :: min_samples = 2048 ! of one tone; with fewer a coarse grid costs more than it saves
      type(harmonics_t) :: band
      type(torus_t) :: thin
      integer :: lane, m, n_lanes

      if (laws%has_memory .or. any(torus%n_samples < 4*harmonics%highest + 1)) return
      if (harmonics%n_tones == 1 .and. torus%n_total*laws%n_dofs < min_samples) return
      call new_torus(thin, [(min(torus%n_samples(m), cheap_size(4*harmonics%highest(m) + 1, harmonics%n_tones)), &
                             m=1, harmonics%n_tones)], harmonics, error)
      if (allocated(error)) return
      if (torus%is_half .and. thin%can_be_halved()) thin = thin%half()
      if (thin%n_total >= torus%n_total) return
      allocate (self)
      call new_band(band, harmonics, torus, error)                    ! fails if it exceeds the largest set
      if (.not. allocated(error)) call new_transform(self%transform, harmonics, thin, laws%n_dofs, error)
      n_lanes = n_threads(laws%jacobian%n_pairs*torus%n_total)
      if (.not. allocated(error)) call new_transform(self%wide, band, torus, 1, error, direction%to_spectrum, n_lanes)
      if (.not. allocated(error)) call new_transform(self%narrow, band, thin, 1, error, direction%to_samples, n_lanes)
      if (.not. allocated(error)) call new_law_samples(self%along, thin%n_total, laws%n_dofs, laws%needs_velocity, &
                                                       laws%needs_reaction, .false., error)
      allocate (self%columns(n_lanes))
      do lane = 1, n_lanes
         if (.not. allocated(error)) call new_real_block(self%columns(lane), thin%n_total, 1, error)
      end do
      if (.not. allocated(error)) then
         self%jacobian = laws%jacobian%pattern()
         call self%jacobian%allocate_slopes(thin%n_total, error)
      end if
      if (.not. allocated(error)) then
         allocate (self%spectra(band%n_coefficients, n_lanes))
      else
         call self%destroy()
         deallocate (self)
      end if
   end subroutine new_thin_grid

   !> The harmonics of slopes needed in a product: up to twice those of the motion; even for odd forces.
   subroutine new_band(band, harmonics, torus, error)
      type(harmonics_t), intent(out) :: band
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: box

      call new_box(box, 2*harmonics%highest, .false., error)
      if (allocated(error)) return
      if (torus%is_half) then
         call new_of_parity(band, box, 0, error)
      else
         band = box
      end if
   end subroutine new_band

   !> Copies the slopes of the laws, after `differentiate`.
   subroutine thin_grid_update(self, laws)
      class(thin_grid_t), intent(inout) :: self
      type(projected_laws_t), intent(in) :: laws
      integer :: i

      !$omp parallel do num_threads(size(self%columns)) if (size(self%columns) > 1)
      do i = 1, laws%jacobian%n_pairs
         call self%bring(laws%jacobian, i, this_thread())
      end do
   end subroutine thin_grid_update

   !> Transforms the slopes of pair i to the coarse grid.
   subroutine thin_grid_bring(self, from, i, lane)
      class(thin_grid_t), intent(inout) :: self
      type(law_jacobian_t), intent(in) :: from
      integer, intent(in) :: i
      integer, intent(in) :: lane                                     !! of the calling thread

      call bring(from%df_dq, self%jacobian%df_dq)
      if (from%needs_velocity) call bring(from%df_dv, self%jacobian%df_dv)
      if (from%needs_reaction) call bring(from%df_ds, self%jacobian%df_ds)

   contains

      subroutine bring(from, to)
         type(real_block_t), intent(in) :: from
         type(real_block_t), intent(inout) :: to

         associate (spectrum => self%spectra(:, lane), column => self%columns(lane)%values(:, 1))
            call self%wide%to_coefficients_of_one(from%values(:, i:i), spectrum, lane)
            call self%narrow%to_samples_of_one(spectrum, column, lane) ! a column of `to` need not be aligned
            to%values(:, i) = column
         end associate
      end subroutine bring
   end subroutine thin_grid_bring

   !> Coefficients of the forces in response to a motion u with the reaction s.
   subroutine thin_grid_apply(self, frequencies, u, s, force)
      class(thin_grid_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(in) :: u(:, :), s(:, :)                        !! (n_coefficients, n_dofs)
      real(wp), intent(out) :: force(:, :)                            !! as u

      associate (along => self%along)
         call self%transform%to_samples(u, along%q%values)
         if (self%jacobian%needs_velocity) call self%transform%to_rate_samples(u, frequencies, along%v%values)
         if (self%jacobian%needs_reaction) call self%transform%to_samples(s, along%s%values)
         along%f%values = 0.0_wp
         call self%jacobian%add_product(along)
         call self%transform%to_coefficients(along%f%values, force)
      end associate
   end subroutine thin_grid_apply

   !> Frees transforms and samples; safe to call twice.
   subroutine thin_grid_destroy(self)
      class(thin_grid_t), intent(inout) :: self
      integer :: lane

      if (allocated(self%spectra)) deallocate (self%spectra)
      call self%transform%destroy()
      call self%wide%destroy()
      call self%narrow%destroy()
      call self%along%destroy()
      call self%jacobian%destroy()
      if (.not. allocated(self%columns)) return
      do lane = 1, size(self%columns)
         call self%columns(lane)%destroy()
      end do
      deallocate (self%columns)
   end subroutine thin_grid_destroy
end module hb_tangent_product
