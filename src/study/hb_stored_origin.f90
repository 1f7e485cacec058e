!> A point of a result file where other motions leave a curve, as the origin of a curve of these.
module hb_stored_origin
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use hb_curve_origin, only: curve_origin_t, new_curve_origin
   use hb_curve_request, only: curve_kind
   use hb_error, only: error_t, fail
   use hb_file_place, only: check_source
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_row_checks, only: refuse_damaged_rows
   use hb_scene, only: scene_t
   use hb_text, only: to_text
   implicit none
   private
   public :: read_curve_origin

contains

   !> Reads the point; fails where it is damaged, is neither a period doubling nor a place where a tone joins, or does not fit the
   !> scene.
   subroutine read_curve_origin(self, path, point, scene, error)
      type(curve_origin_t), intent(out) :: self
      character(*), intent(in) :: path                                !! of the file
      integer, intent(in) :: point                                    !! from 0
      type(scene_t), intent(in) :: scene                              !! of the new curve
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      integer, allocatable :: extents(:), grid(:, :), kind(:), own(:, :, :), status(:), tuples(:, :)
      real(wp), allocatable :: state(:, :)

      call check_source(path, error)
      if (allocated(error)) return
      call open_file(file, path, error)
      if (.not. allocated(error)) call read_all()
      call file%close(error_in_close)
      if (.not. allocated(error)) call refuse_damaged_rows(path, status, [point], error)
      if (.not. allocated(error)) then
         if (.not. any(kind(point + 1) == [curve_kind%flip, curve_kind%torus])) then
            call fail(error, "it is neither a 'flip' nor a 'torus'; 'nhbm info' and 'nhbm-post peaks' list those")
         else
            call take_over()
         end if
      end if
      if (allocated(error)) error%message = "point "//to_text(point)//" of '"//path//"': "//error%message

   contains

      subroutine take_over()
         integer, allocatable :: n_samples(:)
         integer :: n                                                 ! numbers of the state, behind which there is none

         if (allocated(grid)) n_samples = grid(:, 1)
         n = findloc(ieee_is_nan(state(:, 1)), .true., dim=1) - 1
         if (n < 0) n = size(state)
         call new_curve_origin(self, kind(point + 1) == curve_kind%torus, state(:n, 1), tuples, scene, error, n_samples)
      end subroutine take_over

      subroutine read_all()
         if (file%has("tuples")) then
            call read_own_tuples()
         else
            call file%open_dataset("tuple", dataset, error, n_axes=2)
            if (allocated(error)) return
            extents = dataset%get_extents()
            allocate (tuples(extents(1), extents(2)))
            call dataset%read(tuples, error)
         end if
         if (file%has("grid") .and. .not. allocated(error)) then
            allocate (grid(size(tuples, 1), 1))
            call file%open_dataset("grid", dataset, error)
            if (.not. allocated(error)) call dataset%read_rows(point + 1, grid, error)
         end if
         if (.not. allocated(error)) call file%open_dataset("curve_state", dataset, error, n_axes=2)
         if (allocated(error)) return
         extents = dataset%get_extents()
         if (point + 1 > extents(2)) then
            call refuse(extents(2))
            return
         end if
         allocate (state(extents(1), 1))
         call dataset%read_rows(point + 1, state, error)
         call file%get("curve_kind", kind, error, extents(2))
         call file%get("status", status, error, extents(2))
      end subroutine read_all

      subroutine refuse(n_points)
         integer, intent(in) :: n_points

         call fail(error, "the file has "//to_text(n_points)//" points")
      end subroutine refuse

      !> Those of the point, where each has its own.
      subroutine read_own_tuples()
         integer :: n_harmonics(1)

         call file%open_dataset("tuples", dataset, error, n_axes=3)
         if (allocated(error)) return
         extents = dataset%get_extents()
         if (point + 1 > extents(3)) then
            call refuse(extents(3))
            return
         end if
         allocate (own(extents(1), extents(2), 1))
         call dataset%read_rows(point + 1, own, error)
         if (.not. allocated(error)) call file%open_dataset("n_harmonics", dataset, error)
         if (.not. allocated(error)) call dataset%read_rows(point + 1, n_harmonics, error)
         if (.not. allocated(error)) tuples = own(:, :max(1, min(n_harmonics(1), size(own, 2))), 1)
      end subroutine read_own_tuples
   end subroutine read_curve_origin
end module hb_stored_origin
