!> Products with sampled slopes on the smallest grid that gives them exactly.
!>
!> What a product of a slope g with a motion puts into the kept harmonics, |j_m| <= N_m, depends on the spectrum of g up to
!> 2 N_m alone. With that part of it, 4 N_m + 1 samples per tone keep all of this apart; forces of contact are sampled on more.
!> Source: docs/user/theory.md, section 6.6.
module hb_thin_product
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_harmonics, only: harmonics_t, new_box, new_of_parity
   use hb_kinds, only: wp
   use hb_law_pairs, only: add_slopes_along
   use hb_law_set, only: law_set_t
   use hb_packed_fft, only: way
   use hb_torus, only: cheap_size, new_torus, torus_t
   use hb_transform, only: new_transform, transform_t
   implicit none
   private
   public :: new_thin_product, thin_product_t

   !> Owner of outside resources: call `destroy`.
   type :: thin_product_t
      logical :: is_thinner = .false.                                 !! than the grid of the laws; else not to be used
      type(transform_t), private :: transform                         ! of motions
      type(transform_t), private :: wide, narrow                      ! of slopes, on the grid of the laws and on this one
      type(real_block_t), private :: q, v, s, f                       ! (n_samples, n_dofs)
      type(real_block_t), private :: column                           ! (n_samples, 1)
      type(real_block_t), private :: df_dq, df_dv, df_ds              ! (n_samples, n_pairs)
      real(wp), allocatable, private :: spectrum(:, :)                ! (coefficients of a slope, 1)
   contains
      procedure :: update => thin_product_update
      procedure :: apply => thin_product_apply
      procedure, private :: bring => thin_product_bring
      procedure :: destroy => thin_product_destroy
   end type thin_product_t

contains

   !> Prepares products for the laws of a set, where a thinner grid than theirs will do and there is room for what it needs;
   !> `is_thinner` stays false else, as products on the grid of the laws are as exact.
   subroutine new_thin_product(self, harmonics, torus, law_set, effort)
      type(thin_product_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus                              !! of the laws
      type(law_set_t), intent(in) :: law_set
      integer, intent(in) :: effort                                   !! one of hb_fftw%planning
      type(error_t), allocatable :: error
      type(harmonics_t) :: band
      type(torus_t) :: thin
      integer :: m, n

      call self%destroy()
      if (law_set%has_memory .or. any(torus%n_samples < 4*harmonics%highest + 1)) return
      call new_torus(thin, [(min(torus%n_samples(m), cheap_size(4*harmonics%highest(m) + 1, harmonics%n_tones)), &
                             m=1, harmonics%n_tones)], harmonics, error)
      if (allocated(error)) return
      if (torus%is_half .and. thin%can_be_halved()) thin = thin%half()
      if (thin%n_total >= torus%n_total) return
      call new_band(band, harmonics, torus, error)                    ! fails where it has more tuples than a set may have
      if (.not. allocated(error)) call new_transform(self%transform, harmonics, thin, law_set%n_dofs, effort, error)
      if (.not. allocated(error)) call new_transform(self%wide, band, torus, 1, effort, error, way%to_spectrum)
      if (.not. allocated(error)) call new_transform(self%narrow, band, thin, 1, effort, error, way%to_samples)
      n = thin%n_total
      call make(self%q, law_set%n_dofs, .true.)
      call make(self%v, law_set%n_dofs, law_set%needs_velocity)
      call make(self%s, law_set%n_dofs, law_set%needs_reaction)
      call make(self%f, law_set%n_dofs, .true.)
      call make(self%column, 1, .true.)
      call make(self%df_dq, law_set%n_pairs, .true.)
      call make(self%df_dv, law_set%n_pairs, law_set%needs_velocity)
      call make(self%df_ds, law_set%n_pairs, law_set%needs_reaction)
      self%is_thinner = .not. allocated(error)
      if (self%is_thinner) then
         allocate (self%spectrum(band%n_coefficients, 1))
      else
         call self%destroy()
      end if

   contains

      subroutine make(block, n_columns, is_needed)
         type(real_block_t), intent(inout) :: block
         integer, intent(in) :: n_columns
         logical, intent(in) :: is_needed

         if (is_needed .and. .not. allocated(error)) call new_real_block(block, n, n_columns, error)
      end subroutine make
   end subroutine new_thin_product

   !> The harmonics of slopes that a product needs: up to twice those of the motion; of odd forces they are even.
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

   !> Takes over the slopes of the laws, after `differentiate`.
   subroutine thin_product_update(self, law_set)
      class(thin_product_t), intent(inout) :: self
      type(law_set_t), intent(inout) :: law_set
      integer :: i

      do i = 1, law_set%n_pairs
         call self%bring(law_set%df_dq, self%df_dq, i)
         if (law_set%needs_velocity) call self%bring(law_set%df_dv, self%df_dv, i)
         if (law_set%needs_reaction) call self%bring(law_set%df_ds, self%df_ds, i)
      end do
   end subroutine thin_product_update

   !> Brings column i of sampled slopes to the thin grid.
   subroutine thin_product_bring(self, from, to, i)
      class(thin_product_t), intent(inout) :: self
      type(real_block_t), intent(in) :: from, to                      !! what `to` points to is filled
      integer, intent(in) :: i

      call self%wide%to_coefficients_of_one(from%values(:, i:i), self%spectrum(:, 1))
      call self%narrow%to_samples(self%spectrum, self%column%values)  ! a column of `to` need not be aligned
      to%values(:, i) = self%column%values(:, 1)
   end subroutine thin_product_bring

   !> Coefficients of the forces that answer to a motion u with the reaction s.
   subroutine thin_product_apply(self, law_set, frequencies, u, s, force)
      class(thin_product_t), intent(inout) :: self
      type(law_set_t), intent(in) :: law_set
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(in) :: u(:, :), s(:, :)                        !! (n_coefficients, n_dofs)
      real(wp), intent(out) :: force(:, :)                            !! as u

      call self%transform%to_samples(u, self%q%values)
      if (law_set%needs_velocity) call self%transform%to_rate_samples(u, frequencies, self%v%values)
      if (law_set%needs_reaction) call self%transform%to_samples(s, self%s%values)
      self%f%values = 0.0_wp
      call add_slopes_along(law_set%row, law_set%column, self%df_dq, self%df_dv, self%df_ds, self%q, self%v, self%s, self%f)
      call self%transform%to_coefficients(self%f%values, force)
   end subroutine thin_product_apply

   !> Frees transforms and samples; safe to call twice.
   subroutine thin_product_destroy(self)
      class(thin_product_t), intent(inout) :: self

      self%is_thinner = .false.
      if (allocated(self%spectrum)) deallocate (self%spectrum)
      call self%transform%destroy()
      call self%wide%destroy()
      call self%narrow%destroy()
      call self%q%destroy()
      call self%v%destroy()
      call self%s%destroy()
      call self%f%destroy()
      call self%column%destroy()
      call self%df_dq%destroy()
      call self%df_dv%destroy()
      call self%df_ds%destroy()
   end subroutine thin_product_destroy
end module hb_thin_product
